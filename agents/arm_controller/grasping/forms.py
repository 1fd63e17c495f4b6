"""What matters of a thing's form to a gripper: whether it is round, where it is widest, and whether it has a rim."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.scene import Obstacle
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import rotate
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose

THICKEST = 0.02
"""m, of a wall that is held at its rim: thicker ones are solid blocks to fingers"""

_ROUND = 1.06  # greatest radius over least of what counts as round: an upright prism of 12 sides has 1.035
_DIRECTIONS = 24  # in which the outline is measured
_STEP = 0.0005  # m between two points of a ray
_BELOW = 0.005  # m below the rim where walls are measured: as much as must be between pads


@dataclass(frozen=True)
class Wall:
    """A piece of a rim."""

    direction: tuple[float, float, float]
    """Unit vector outwards, in the thing's frame"""
    inner: float
    """m from the thing's axis"""
    outer: float
    """m from the thing's axis"""


@dataclass(frozen=True)
class GripForm:
    """The form of a thing, apart from its box."""

    ball: bool = False
    """Whether it looks the same from everywhere."""
    round: bool = False
    """Whether it looks the same from all sides, about its own z axis."""
    rolls: bool = False
    """Whether it is a cylinder that may lie."""
    walls: tuple[Wall, ...] = ()
    """Pieces of a rim around a hollow that is open towards its own +z."""


PLAIN = GripForm()
"""A box."""


def form(thing: Obstacle) -> GripForm:
    """What is known of a thing's form; a box without any shape."""
    return _form(thing.shape, thing.size)


def parts_beside(thing: Obstacle, wall: Wall) -> list[Obstacle]:
    """The parts of a thing, as boxes in the world, that are not around a piece of its rim."""
    found = []
    for number, part in enumerate(thing.shape):
        x, y, _ = part.position
        away = math.hypot(x, y)
        near = away > 0.0 and (x * wall.direction[0] + y * wall.direction[1]) / away > 0.5
        if not (near and away > wall.inner / 2):
            pose = thing.pose @ Pose(part.position, part.rotation)
            found.append(Obstacle(f"{thing.name} itself ({number})", pose, part.size))
    return found


@lru_cache(maxsize=64)
def _form(shape: Shape, size: tuple[float, float, float]) -> GripForm:
    kinds = [part.kind for part in shape]
    if kinds == ["sphere"]:
        return GripForm(ball=True, round=True, rolls=True)
    if kinds == ["cylinder"]:
        return GripForm(round=rotate(shape[0].rotation, (0.0, 0.0, 1.0))[2] ** 2 > 0.99, rolls=True)
    if not shape:
        return PLAIN
    rays = [_ray(shape, size, 2.0 * math.pi * k / _DIRECTIONS) for k in range(_DIRECTIONS)]
    outer = [wall.outer for wall in rays]
    is_round = min(outer) > 0.0 and max(outer) / min(outer) < _ROUND
    usable = rays[:: _DIRECTIONS // (12 if is_round else 4)]
    walls = tuple(wall for wall in usable if wall.inner > 0.0 and wall.outer - wall.inner <= THICKEST)
    return GripForm(round=is_round, walls=walls)


def _ray(shape: Shape, size: tuple[float, float, float], angle: float) -> Wall:
    """The outermost piece of the thing in one direction, a little below its top; from 0 to 0 if there is none."""
    direction = (math.cos(angle), math.sin(angle), 0.0)
    radii = np.arange(math.hypot(size[0], size[1]) / 2, 0.0, -_STEP)
    points = np.column_stack([radii[:, None] * np.array(direction)[:2], np.full(len(radii), size[2] / 2 - _BELOW)])
    inside = _inside(shape, points)
    if not inside.any():
        return Wall(direction, 0.0, 0.0)
    first = int(np.argmax(inside))
    beyond = np.flatnonzero(~inside[first:])
    inner = float(radii[first + beyond[0]]) if len(beyond) else 0.0
    return Wall(direction, inner, float(radii[first]))


def _inside(shape: Shape, points: Array) -> NDArray[np.bool_]:
    """(n,) which points (n, 3) m of the thing's frame are within one of its parts."""
    found = np.zeros(len(points), dtype=bool)
    for part in shape:
        pose = Pose(part.position, part.rotation)
        local, half = pose.inverse().apply(points), np.array(part.size) / 2
        if part.kind == "sphere":
            found |= np.linalg.norm(local, axis=1) <= half[0]
        elif part.kind == "cylinder":
            found |= (np.hypot(local[:, 0], local[:, 1]) <= half[0]) & (np.abs(local[:, 2]) <= half[2])
        else:
            found |= (np.abs(local) <= half).all(axis=1)
    return found
