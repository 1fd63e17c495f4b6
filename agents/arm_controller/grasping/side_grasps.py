"""Ways to grasp an object from its side, level or from obliquely above, as poses of the tool in the world.

They are for what cannot be grasped from above: because something is above it, because it is too tall for the arm, or
because it is too wide for the gripper that way and overhangs what it stands on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from agents.arm_controller.grasping.grasps import (
    FROM_SIDE,
    LEAST_HOLD,
    SIDE_ROOM,
    Grasp,
    GraspError,
    Upright,
    around,
    openings,
    upright,
)
from agents.arm_controller.grasping.room import Room
from agents.arm_controller.scene import Obstacle
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

ELEVATIONS = (0.0, 0.5, 1.0)
"""rad above the horizontal from which the gripper comes: level, and where the table is too near for its palm"""

_STEP = 0.01  # m between two heights of the tool point; half of a pad
_HEIGHTS = 9  # that are tried for one object, from its middle up and down
_INTO = 0.017  # m behind the near face of a box at which it is held, as from above
_BEHIND = 0.2  # cosine beyond a right angle from which the gripper would have to come from behind the object
_STANDS_ON = 0.01  # m above an object within which something counts as standing on it: tops are known to some mm
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class _Side:
    """One way to close the pads, from one direction."""

    axis: Array
    """(3,) world, from pad to pad"""
    way: Array
    """(3,) world, horizontal, in which the gripper goes"""
    width: float
    """m between the pads"""
    depth: float
    """m of the object along the way"""
    longer: int
    """0 for the shorter side of the object"""


def side_grasps(thing: Obstacle, room: Room, widest: float, base: Vector3) -> list[Grasp]:
    """Grasps from the sides for which there is room; none if something stands on the object, which would fall.

    Better are level ones, then those nearer to the middle, then those with more room for the fingers.

    Args:
        thing: what to grasp.
        room: what is around it.
        widest: m, the largest opening of the gripper.
        base: m (world), where the arm stands: it does not reach around the object.
    """
    try:
        body = upright(thing)
    except GraspError:
        return []
    if any(_stands_on(other, thing) for other in room.things):
        return []
    outwards = body.center[:2] - base[:2]
    sides = [side for side in _sides(body, widest) if side.way[:2] @ outwards > -_BEHIND * np.linalg.norm(outwards)]
    return [grasp for side in sides for grasp in _free(side, body, room, widest)]


def _free(side: _Side, body: Upright, room: Room, widest: float) -> list[Grasp]:
    """For each steepness and turn of the gripper the place nearest to the middle at which it has room, if any."""
    found = dict[tuple[int, float], Grasp]()
    ranked = list(_tools(side, body, room.throat(side.width)))
    for cramped, opening in openings(side.width, widest):
        taken = room.blockers([tool for tool, *_ in ranked], side.width, opening)
        for (tool, steep, away, sign), names in zip(ranked, taken, strict=True):
            if not names and (steep, sign) not in found:
                rank = (FROM_SIDE, steep, away, cramped, side.longer)
                found[steep, sign] = Grasp(tool, opening, side.width, rank)
    return list(found.values())


def _stands_on(other: Obstacle, thing: Obstacle) -> bool:
    """Whether `other` stands on the thing."""
    low = float(other.pose.t[2] - other.reach[2])
    over = np.abs(np.subtract(other.pose.t, thing.pose.t))[:2] < other.reach[:2] + thing.reach[:2]
    return bool(over.all()) and abs(low - thing.top) < _STANDS_ON


def _sides(body: Upright, widest: float) -> Iterator[_Side]:
    """All ways to close on the object, pads upright at its sides or level above and below."""
    fits = widest - min(SIDE_ROOM)
    for axis, width, across, longer in around(body):
        if width <= fits:
            way = np.cross(axis, _UP)
            depth = across or width
            yield from (_Side(axis, sign * way, width, depth, longer) for sign in (1.0, -1.0))
    if body.height <= fits and not body.form.walls:
        for (way, depth), _ in (body.sides, body.sides[::-1]):
            yield from (_Side(_UP, sign * way, body.height, depth, 1) for sign in (1.0, -1.0))


def _tools(side: _Side, body: Upright, throat: float) -> Iterator[tuple[Pose, int, int, float]]:
    """world_from_tool; how steep it is, and how far from the best place, both from 0 on; which way round it is."""
    is_flat = bool(side.axis[2])
    into = side.depth / 2 if body.form.round else min(_INTO, side.depth / 2)
    into = min(into, throat)
    place = body.center + (into - side.depth / 2) * side.way
    for steep, elevation in enumerate(ELEVATIONS[:1] if is_flat else ELEVATIONS):
        z_axis = math.cos(elevation) * side.way - math.sin(elevation) * _UP
        for away, lift in enumerate(_lifts(body.height) if not (is_flat or body.form.rolls) else (0.0,)):
            if _behind(into, body.height / 2 - lift, elevation) > throat:
                continue  # the palm would meet the object
            for sign in (1.0, -1.0):
                yield _pose(place + lift * _UP, sign * side.axis, z_axis), steep, away, sign


def _behind(into: float, below: float, elevation: float) -> float:
    """How far (m) the object reaches from the tool point towards the palm: to its near face or to its top."""
    return min(into / math.cos(elevation), below / max(math.sin(elevation), 1e-9))


def _lifts(height: float) -> Sequence[float]:
    """Heights (m) of the tool point above the middle of an object, the nearest first."""
    most = height / 2 - LEAST_HOLD
    steps = [0.0, *(sign * _STEP * k for k in range(1, _HEIGHTS // 2 + 1) for sign in (1.0, -1.0))]
    return [lift for lift in steps if abs(lift) <= most or lift == 0.0]


def _pose(position: Array, x_axis: Array, z_axis: Array) -> Pose:
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x_axis, np.cross(z_axis, x_axis), z_axis
    matrix[:3, 3] = position
    return Pose.from_matrix(matrix)
