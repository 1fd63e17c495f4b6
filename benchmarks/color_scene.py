"""Objects of `etc/objects` on a table before a camera that looks at them from anywhere: rendered, then camera noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.object_models import find_model, load_model
from agents.plant.bullet import Bullet
from agents.plant.noise import SensorModel, shift_bodies
from agents.plant.renderer import Renderer
from agents.plant.world import World
from agents.scenario.format.scenario import ObjectSpec, SensorSpec, TableSpec
from agents.scene_estimator.colored import ColoredObject
from dsr.images.blobs import Frame
from dsr.math3d import transforms
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

AWAY = Pose((0.0, 0.0, -20.0))
"""Where nothing is seen."""


class ColorScene:
    """A rendered world of objects recognised by their colour; all are away until they are put somewhere.

    Args:
        models: of the objects, which are called like them.
        rng: of the camera's noise.
        others: further objects.
    """

    def __init__(
        self, models: Iterable[str], rng: np.random.Generator, others: Iterable[ObjectSpec] = (), width: int = 640
    ) -> None:
        self.intrinsics = Intrinsics.from_fov(width, width * 3 // 4, 0.98)
        self._bullet = Bullet()
        self._renderer = Renderer(self._bullet)
        specs = [*map(made_of, models), *others]
        self.known = [
            ColoredObject(spec.name, spec.color, spec.size, spec.shape) for spec in specs if spec.color and spec.model
        ]
        self._world = World(self._bullet, TableSpec(), specs)
        self.draw_noise_from(rng)
        for name in self._world:
            self.put(name, AWAY)

    def put(self, name: str, world_from_object: Pose) -> None:
        """Let an object be at a pose."""
        self._world.put(name, world_from_object)

    def draw_noise_from(self, rng: np.random.Generator) -> None:
        """Let the camera's noise come from a generator, from the next frame on."""
        self._sensor = SensorModel(SensorSpec(), [], rng)

    def height(self, name: str) -> float:
        """Of the centre of an object that stands on the table, m."""
        return self._world.specs[name].size[2] / 2

    def pixels(self, name: str, world_from_camera: Pose) -> int:
        """How many pixels show an object."""
        bodies = self._renderer.render(world_from_camera, self.intrinsics, bodies=True).bodies
        assert bodies is not None
        return int((bodies == self._world.body(name)).sum())

    def frame(self, world_from_camera: Pose, nearer: Mapping[str, float] | None = None) -> Frame:
        """What a camera sees; of the objects in `nearer`, all depths are so much too small (m)."""
        picture, intrinsics = self._renderer.render(world_from_camera, self.intrinsics, bodies=True), self.intrinsics
        assert picture.bodies is not None
        errors = {self._world.body(name): error for name, error in (nearer or {}).items()}
        depth = shift_bodies(picture.depth, picture.bodies, errors, intrinsics)
        arrays: dict[str, NDArray[np.generic]] = {
            "color": self._sensor.color(picture.color),
            "depth": self._sensor.depth(depth, intrinsics),
        }
        return Frame(0.0, arrays, {"fx": intrinsics.fx, "fy": intrinsics.fy, "cx": intrinsics.cx, "cy": intrinsics.cy})

    def close(self) -> None:
        """Free the renderer and the physics engine."""
        self._renderer.close()
        self._bullet.close()


def made_of(model: str) -> ObjectSpec:
    """A known object of a model, called like it."""
    given = {
        name: value for name, value in load_model(find_model(model, Path()))._asdict().items() if value is not None
    }
    return ObjectSpec(name=model, model=model, known=True, position=(0.0, 0.0, 0.0), **given)


def looking_at(target: Vector3, distance: float, rng: np.random.Generator, *, spread: float = 0.08) -> Pose:
    """A random world_from_camera at `distance` m from a target, 35 to 80 degrees above the horizon."""
    azimuth, height = rng.uniform(0.0, 2 * np.pi), rng.uniform(np.radians(35), np.radians(80))
    away = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])
    eye = target + distance * away
    at = target + np.append(rng.uniform(-spread, spread, 2), 0.0)
    return transforms.looking_at(tuple(eye.tolist()), tuple(at.tolist()))
