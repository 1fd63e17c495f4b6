"""Ways to grasp an object from above and to put it down, as poses of the tool in the world.

The tool's z axis points out of the gripper, its x axis from pad to pad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.obstacles import GRIPPER_MARGIN
from agents.arm_controller.room import Room
from agents.arm_controller.scene import Obstacle
from dsr.errors import DsrError
from dsr.math3d.boxes import Array
from dsr.math3d.transforms import Pose

MOST_TILT = 0.26
"""rad that an object may lean and still be grasped from above or stood upon"""
SIDE_ROOM = (0.03, 0.012, 0.004)
"""m that the fingers open wider than the object: usually, between neighbours, and at the least"""
LEAST_HOLD = 0.005
"""m of an object's height that must be between the pads: where its top is is known to some mm only"""

_DEPTH = 0.017  # m below the top of an object at which it is held, if there is room to get there
_ENOUGH = 0.75  # of the greatest hold that there is room for: less is worse than being off the middle, or cramped
_MOST_ASIDE = 0.25  # of its length, off its middle: an object that is held farther out turns between the pads
_STEP = 0.001  # m between two heights of the tool point that are tried
_STEP_ASIDE = 0.0025  # m between two places of the tool point that are tried along the pads
_GROUND = GRIPPER_MARGIN + _STEP  # m that the pads stay above what the object stands on, as far as that is known
_SQUARE = 0.002  # m by which the sides of a square may differ

Rank = tuple[int, int, int, int]
"""Whether it holds little, whether it is off the middle, how cramped the fingers are, which side it is across"""


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
    rank: Rank = (0, 0, 0, 0)
    """Rank of the grasp; lower ranks are better."""


@dataclass(frozen=True)
class Upright:
    """An object that stands: its axes with the vertical one known."""

    center: Array
    """(3,) m, centre of the object in the world"""
    sides: tuple[tuple[Array, float], tuple[Array, float]]
    """Horizontal axes (3,), world, with the length (m) of the object along them"""
    height: float
    """Height of the object, m."""

    @property
    def is_square(self) -> bool:
        """Whether the object looks the same from above after a quarter turn."""
        (_, one), (_, other) = self.sides
        return abs(one - other) <= _SQUARE

    @property
    def narrowest(self) -> float:
        """The shorter side, m."""
        return min(length for _, length in self.sides)

    @property
    def yaw(self) -> float:
        """Rad, of its first horizontal axis."""
        x, y, _ = self.sides[0][0]
        return math.atan2(y, x)

    @property
    def top(self) -> float:
        """Height of its top, m in the world."""
        return float(self.center[2]) + self.height / 2


def upright(thing: Obstacle) -> Upright:
    """How the thing stands. Raises `GraspError` if it leans."""
    turn = thing.pose.rotation_matrix
    vertical = int(np.argmax(np.abs(turn[2])))
    lean = math.acos(min(1.0, abs(float(turn[2, vertical]))))
    if lean > MOST_TILT:
        raise GraspError(f"{thing.name} leans by {math.degrees(lean):.0f} degrees")
    one, other = (index for index in range(3) if index != vertical)
    sides = ((_level(turn[:, one]), thing.size[one]), (_level(turn[:, other]), thing.size[other]))
    return Upright(np.array(thing.pose.t), sides, thing.size[vertical])


def grasps(thing: Obstacle, room: Room, widest: float) -> list[Grasp]:
    """Top grasps, each as deep as there is room for.

    Better are those that hold nearly as much as any, then those in the middle of the object, then those with more room
    for the fingers, then those across the shorter side.

    Args:
        thing: what to grasp.
        room: what is around it.
        widest: m, the largest opening of the gripper.

    Raises:
        GraspError: if it leans, is too wide or too low, or the gripper has no room around it, with what takes that.
    """
    body = upright(thing)
    closings = _closings(thing.name, body, widest)
    heights = _heights(thing.name, body, room.reach)
    found: list[tuple[Grasp, float]] = []
    in_the_closing = dict[str, None]()
    for closing in closings:
        grasp, blockers = _roomy(closing, body, heights, room)
        if grasp is None:
            in_the_closing |= dict.fromkeys(blockers)
        else:
            found.append((grasp, body.top - grasp.world_from_tool.t[2] + room.reach))
    if not found:
        who = f"{', '.join(in_the_closing)} {'is' if len(in_the_closing) == 1 else 'are'}"
        raise GraspError(f"there is no room for the gripper around {thing.name}: {who} in the way")
    enough = _ENOUGH * max(hold for _, hold in found)
    return [replace(grasp, rank=(int(hold < enough), *grasp.rank[1:])) for grasp, hold in found]


@dataclass(frozen=True)
class _Closing:
    """A direction and opening of the gripper."""

    axis: Array
    """(3,) world, from pad to pad"""
    width: float
    """m of the object along it"""
    across: float
    """m of the object across it"""
    opening: float
    """m"""
    rank: tuple[int, int]
    """Lower is better: by room for the fingers, then by side of the object."""

    def tool(self, center: Array, aside: float, height: float) -> Pose:
        """world_from_tool, `aside` m off the middle along the pads, at `height` m."""
        x, y, _ = center + aside * np.cross((0.0, 0.0, -1.0), self.axis)
        return looking_down((float(x), float(y), height), self.axis)


def _closings(name: str, body: Upright, widest: float) -> list[_Closing]:
    """All that fit the object."""
    if body.narrowest + min(SIDE_ROOM) > widest:
        raise GraspError(f"{name} is {body.narrowest * 1e3:.0f} mm wide, too wide for {widest * 1e3:.0f} mm")
    one, other = sorted(body.sides, key=lambda side: side[1])
    return [
        _Closing(sign * axis, width, across, opening, (cramped, 0 if body.is_square else longer))
        for longer, ((axis, width), (_, across)) in enumerate(((one, other), (other, one)))
        if width + min(SIDE_ROOM) <= widest
        for cramped, opening in enumerate(dict.fromkeys(min(width + room, widest) for room in SIDE_ROOM))
        for sign in (1.0, -1.0)
    ]


def _heights(name: str, body: Upright, reach: float) -> Array:
    """(n,) heights of the tool point (m, world) that are tried, the deepest first; pads reach `reach` m beyond it.

    What the object stands on may not be known, so the pads keep away from its bottom as from what is known. Raises
    `GraspError` for an object that is too low for that.
    """
    deepest = max(body.top - _DEPTH, body.top - body.height + _GROUND + reach)
    highest = body.top - LEAST_HOLD + reach
    if deepest > highest:
        least = _GROUND + LEAST_HOLD
        raise GraspError(f"{name} is {body.height * 1e3:.1f} mm high, too low: expected at least {least * 1e3:.1f} mm")
    return np.linspace(deepest, highest, math.ceil((highest - deepest) / _STEP) + 1)


def _roomy(closing: _Closing, body: Upright, heights: Array, room: Room) -> tuple[Grasp | None, tuple[str, ...]]:
    """The grasp in the middle and as deep as wanted, or else the nearest aside that holds enough.

    Without room anywhere it is None, with what takes that in the middle.
    """

    def blockers(asides: Array, at: NDArray[np.intp]) -> list[tuple[str, ...]]:
        tools = [closing.tool(body.center, *place) for place in zip(asides.tolist(), heights[at].tolist(), strict=True)]
        return room.blockers(tools, closing.width, closing.opening)

    count = int(closing.across * _MOST_ASIDE / _STEP_ASIDE)
    asides = np.array(sorted(range(-count, count + 1), key=abs)) * _STEP_ASIDE
    if not blockers(asides[:1], np.zeros(1, dtype=np.intp))[0]:
        lowest = closing.tool(body.center, 0.0, float(heights[0]))
        return Grasp(lowest, closing.opening, closing.width, (0, 0, *closing.rank)), ()
    low, high = np.zeros(len(asides), dtype=np.intp), np.full(len(asides), len(heights) - 1)
    taken = blockers(asides, high)
    while (low < high).any():  # what is free stays so higher up: the way there comes from above
        middle = (low + high) // 2
        free = np.array([not names for names in blockers(asides, middle)])
        low, high = np.where(free, low, np.minimum(middle + 1, high)), np.where(free, middle, high)
    tops = body.top - heights[high] + room.reach
    holds = np.where([not names for names in taken], tops, 0.0)
    if not holds.any():
        return None, taken[0]
    best = int(np.argmax(holds >= _ENOUGH * holds.max()))
    tool = closing.tool(body.center, float(asides[best]), float(heights[high[best]]))
    return Grasp(tool, closing.opening, closing.width, (0, int(best > 0), *closing.rank)), ()


def looking_down(position: tuple[float, float, float], x_axis: Array) -> Pose:
    """world_from_tool at `position`, pointing down, with the pads along the horizontal `x_axis` (3,)."""
    down = np.array([0.0, 0.0, -1.0])
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x_axis, np.cross(down, x_axis), down
    matrix[:3, 3] = position
    return Pose.from_matrix(matrix)


def resting_poses(held: Obstacle, position: tuple[float, float], top: float, yaw: float) -> list[Pose]:
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
