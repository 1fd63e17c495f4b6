"""Where an arm may work, and where it must never be: boxes in the configuration, and nodes of the graph."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.scene import ArmScene, Obstacle
from dsr.errors import ConfigError
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

EDGE = "the edge of the workspace"


class Zone(msgspec.Struct, frozen=True):
    """A box along the axes of the world."""

    lower: Vector3
    """m, the least x, y, z"""
    upper: Vector3
    """m, the greatest"""

    def room(self, points: Array) -> Array:
        """(m,) m that `points` (m, 3) of the world are within the box; negative outside."""
        low, high = np.array(self.lower), np.array(self.upper)
        return np.asarray(np.minimum(points - low, high - points).min(axis=1))


class Zones:
    """The zones of one arm.

    Args:
        workspace: where the tool point may be; None for everywhere.
        forbidden: where no part of the arm and of what it carries may be, by name.
        scene: the belief, in which nodes of type `zone` are forbidden too.

    Raises:
        ConfigError: for a box without an inside.
    """

    def __init__(self, workspace: Zone | None, forbidden: Mapping[str, Zone], scene: ArmScene) -> None:
        boxes = {**forbidden, **({} if workspace is None else {"workspace": workspace})}
        for name, zone in boxes.items():
            if not all(low < high for low, high in zip(zone.lower, zone.upper, strict=True)):
                raise ConfigError(f"zone {name!r}: expected `lower` less than `upper` along each axis")
        self.workspace = workspace
        """Where the tool point may be; None for everywhere."""
        self._fixed = [_obstacle(name, zone) for name, zone in forbidden.items()]
        self._scene = scene

    def forbidden(self) -> list[Obstacle]:
        """The boxes in which no part of the arm may be, now."""
        return [*self._fixed, *self._scene.zones()]


def _obstacle(name: str, zone: Zone) -> Obstacle:
    low, high = np.array(zone.lower), np.array(zone.upper)
    x, y, z = ((low + high) / 2).tolist()
    u, v, w = (high - low).tolist()
    return Obstacle(name, Pose((x, y, z)), (u, v, w))
