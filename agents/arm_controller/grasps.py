"""Ways to grasp an object from above and to put it down, as poses of the tool in the world.

The tool's z axis points out of the gripper, its x axis from pad to pad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from agents.arm_controller.obstacles import STANDOFF
from agents.arm_controller.overlap import Array
from agents.arm_controller.room import Room
from agents.arm_controller.scene import Thing
from dsr.errors import DsrError
from dsr.transforms import Pose

MOST_TILT = 0.26
"""rad that an object may lean and still be grasped from above or stood upon"""
SIDE_ROOM = (0.03, 0.012, 0.004)
"""m that the fingers open wider than the object: usually, between neighbours, and at the least"""
LEAST_HOLD = 0.005
"""m of an object's height that must be between the pads: where its top is is known to some mm only"""

_DEPTH = 0.017  # m below the top of an object at which it is held, if there is room to get there
_STEP = 0.001  # m between two heights of the tool point that are tried
_SQUARE = 0.002  # m by which the sides of a square may differ


class GraspError(DsrError):
    """An object that cannot be grasped or stood upon."""


@dataclass(frozen=True)
class Grasp:
    """A way to grasp."""

    world_from_tool: Pose
    opening: float
    """m between the fingers on the way there"""
    width: float
    """m of the object between the pads"""
    rank: int = 0
    """Those of a lower rank are better."""


@dataclass(frozen=True)
class Upright:
    """An object that stands: its axes with the vertical one known."""

    center: Array
    """(3,) m, world"""
    sides: tuple[tuple[Array, float], tuple[Array, float]]
    """Horizontal axes (3,), world, with the length (m) of the object along them"""
    height: float
    """m"""

    @property
    def is_square(self) -> bool:
        """Whether it looks the same from above after a quarter turn."""
        (_, one), (_, other) = self.sides
        return abs(one - other) <= _SQUARE

    @property
    def yaw(self) -> float:
        """Rad, of its first horizontal axis."""
        x, y, _ = self.sides[0][0]
        return math.atan2(y, x)

    @property
    def top(self) -> float:
        """Height of its top, m in the world."""
        return float(self.center[2]) + self.height / 2


def upright(thing: Thing) -> Upright:
    """How the thing stands. Raises `GraspError` if it leans."""
    turn = thing.pose.rotation_matrix
    vertical = int(np.argmax(np.abs(turn[2])))
    lean = math.acos(min(1.0, abs(float(turn[2, vertical]))))
    if lean > MOST_TILT:
        raise GraspError(f"{thing.name} leans by {math.degrees(lean):.0f} degrees")
    one, other = (index for index in range(3) if index != vertical)
    sides = ((_level(turn[:, one]), thing.size[one]), (_level(turn[:, other]), thing.size[other]))
    return Upright(np.array(thing.pose.t), sides, thing.size[vertical])


def grasps(thing: Thing, room: Room, widest: float) -> list[Grasp]:
    """Top grasps, each as deep as there is room for.

    Those with less than half of the greatest hold are worse than all others. Apart from that, better are those with
    more room for the fingers, then those across the shorter side.

    Args:
        thing: what to grasp.
        room: what is around it.
        widest: m, the largest opening of the gripper.

    Raises:
        GraspError: if it leans, is too wide or too low, or the gripper has no room around it, with what takes that.
    """
    body = upright(thing)
    ways = _ways(thing, body, widest)
    heights = _heights(thing.name, body, room.reach)
    found: list[tuple[Grasp, float]] = []
    in_the_way = dict[str, None]()
    for way in ways:
        tools = [_at_height(way.world_from_tool, height) for height in heights]
        blockers = room.blockers(tools[:1], way.width, way.opening)
        blockers += room.blockers(tools[1:], way.width, way.opening) if blockers[0] else []
        if "" in blockers:
            depth = blockers.index("")
            found.append((replace(way, world_from_tool=tools[depth]), body.top - heights[depth] + room.reach))
        else:
            in_the_way[blockers[-1]] = None
    if not found:
        raise GraspError(f"no room for the gripper around {thing.name}, because of {', '.join(in_the_way)}")
    half = max(hold for _, hold in found) / 2
    return [replace(grasp, rank=grasp.rank + (len(ways) if hold < half else 0)) for grasp, hold in found]


def _ways(thing: Thing, body: Upright, widest: float) -> list[Grasp]:
    """Directions and openings of the gripper that fit the object, at the height of its centre."""
    fitting = [side for side in body.sides if side[1] + min(SIDE_ROOM) <= widest]
    if not fitting:
        narrow = min(length for _, length in body.sides)
        raise GraspError(f"{thing.name} is {narrow * 1e3:.0f} mm wide, too wide for {widest * 1e3:.0f} mm")
    fitting.sort(key=lambda side: side[1])
    x, y, z = body.center.tolist()
    return [
        Grasp(looking_down((x, y, z), sign * axis), opening, width, 2 * cramped + (0 if body.is_square else longer))
        for longer, (axis, width) in enumerate(fitting)
        for cramped, opening in enumerate(dict.fromkeys(min(width + room, widest) for room in SIDE_ROOM))
        for sign in (1.0, -1.0)
    ]


def _heights(name: str, body: Upright, reach: float) -> list[float]:
    """Heights of the tool point (m, world) that are tried, the deepest first, for pads that reach `reach` m beyond it.

    What the object stands on may not be known, so the pads keep away from its bottom as from what is known. Raises
    `GraspError` for an object that is too low for that.
    """
    deepest = max(body.top - _DEPTH, body.top - body.height + reach + STANDOFF)
    highest = body.top + reach - LEAST_HOLD
    if deepest > highest:
        least = STANDOFF + LEAST_HOLD
        raise GraspError(f"{name} is {body.height * 1e3:.1f} mm high, too low: expected at least {least * 1e3:.1f} mm")
    heights: list[float] = np.arange(deepest, highest, _STEP).tolist()
    return heights


def _at_height(world_from_tool: Pose, height: float) -> Pose:
    x, y, _ = world_from_tool.t
    return Pose((x, y, height), world_from_tool.q)


def looking_down(position: tuple[float, float, float], x_axis: Array) -> Pose:
    """world_from_tool at `position`, pointing down, with the pads along the horizontal `x_axis` (3,)."""
    down = np.array([0.0, 0.0, -1.0])
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x_axis, np.cross(down, x_axis), down
    matrix[:3, 3] = position
    return Pose.from_matrix(matrix)


def resting_poses(held: Thing, position: tuple[float, float], top: float, yaw: float) -> list[Pose]:
    """world_from_object of the held object, standing at x, y with its bottom at height `top` (m).

    Its yaw is `yaw`, up to turns that leave its outline as it is. Raises `GraspError` if it leans in the gripper.
    """
    body = upright(held)
    step = math.pi / 2 if body.is_square else math.pi
    turns = [yaw - body.yaw + step * number for number in range(round(2 * math.pi / step))]
    level = _levelled(held.pose)
    return [
        Pose((*position, top + body.height / 2), Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, turn)).q)
        @ Pose((0.0, 0.0, 0.0), level.q)
        for turn in turns
    ]


def _levelled(pose: Pose) -> Pose:
    """The pose without its lean: the axis that is nearly vertical made so by the shortest turn."""
    turn = pose.rotation_matrix
    vertical = int(np.argmax(np.abs(turn[2])))
    axis = turn[:, vertical] * np.sign(turn[2, vertical])
    cross = np.cross(axis, (0.0, 0.0, 1.0))
    sine = float(np.linalg.norm(cross))
    if sine < 1e-9:
        return pose
    angle = math.atan2(sine, float(axis[2]))
    return Pose((0.0, 0.0, 0.0), Pose.from_rotvec((0.0, 0.0, 0.0), cross / sine * angle).q) @ pose


def _level(axis: Array) -> Array:
    """The axis (3,) made horizontal, of length 1."""
    flat = np.array([axis[0], axis[1], 0.0])
    level: Array = flat / np.linalg.norm(flat)
    return level
