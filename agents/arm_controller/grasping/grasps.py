"""Ways to grasp an object from above, around it or at its rim, and to put it down, as poses of the tool in the world.

The tool's z axis points out of the gripper, its x axis from pad to pad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.grasping.forms import PLAIN, GripForm, Wall, form, parts_beside
from agents.arm_controller.grasping.room import Room
from agents.arm_controller.motion.obstacles import GRIPPER_MARGIN
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
_PAST_MIDDLE = 0.0005  # m by which pads must reach beyond the middle of what rolls
_SQUARE = 0.002  # m by which the sides of a square may differ

Rank = tuple[int, int, int, int, int]
"""From where it comes, whether it holds little, whether it is off the middle, how cramped the fingers are, which side
it is across"""
FROM_ABOVE, AT_RIM, FROM_SIDE = range(3)
"""The first number of a rank"""
_YAWS = 6  # directions in which a round thing is gripped, evenly over half a turn


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
    rank: Rank = (0, 0, 0, 0, 0)
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
    form: GripForm = PLAIN
    """Its form, apart from its box."""

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
    """How the thing stands. Raises `GraspError` if it leans. A ball does not."""
    known = form(thing)
    turn = np.eye(3) if known.ball else thing.pose.rotation_matrix
    vertical = int(np.argmax(np.abs(turn[2])))
    lean = math.acos(min(1.0, abs(float(turn[2, vertical]))))
    if lean > MOST_TILT:
        raise GraspError(f"{thing.name} leans by {math.degrees(lean):.0f} degrees")
    one, other = (index for index in range(3) if index != vertical)
    sides = ((_level(turn[:, one]), thing.size[one]), (_level(turn[:, other]), thing.size[other]))
    stands = vertical == 2 or known.ball
    walls = known.walls if stands and turn[2, 2] > 0.0 else ()
    known = replace(known, round=known.round and stands, rolls=known.ball or (known.rolls and not stands), walls=walls)
    return Upright(np.array(thing.pose.t), sides, thing.size[vertical], known)


def grasps(thing: Obstacle, room: Room, widest: float) -> list[Grasp]:
    """Grasps from above, around the object or at its rim, each as deep as there is room for.

    Better are those around it, then those that hold nearly as much as any, then those in the middle of the object, then
    those with more room for the fingers, then those across the shorter side.

    Args:
        thing: what to grasp.
        room: what is around it.
        widest: m, the largest opening of the gripper.

    Raises:
        GraspError: if it leans, is too wide or too low, or the gripper has no room around it, with what takes that.
    """
    body = upright(thing)
    rims = [rim for wall in body.form.walls for rim in _rims(thing, body, wall, room, widest)]
    closings = [(closing, room) for closing in _closings(thing.name, body, widest, needed=not rims)]
    found: list[tuple[Grasp, float]] = []
    in_the_closing = dict[str, None]()
    for closing, around in [*closings, *rims]:
        heights = _heights(thing.name, body, room.reach, room.throat(closing.width))
        grasp, blockers = _roomy(closing, body, heights, around)
        if grasp is None:
            in_the_closing |= dict.fromkeys(blockers)
        else:
            found.append((grasp, body.top - grasp.world_from_tool.t[2] + room.reach))
    if not found:
        who = f"{', '.join(in_the_closing)} {'is' if len(in_the_closing) == 1 else 'are'}"
        raise GraspError(f"there is no room for the gripper around {thing.name}: {who} in the way")
    enough = _ENOUGH * max(hold for _, hold in found)
    return [replace(grasp, rank=(grasp.rank[0], int(hold < enough), *grasp.rank[2:])) for grasp, hold in found]


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
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m (world), from the middle of the object to that of what is between the pads"""
    way: int = FROM_ABOVE

    def tool(self, center: Array, aside: float, height: float) -> Pose:
        """world_from_tool, `aside` m off the middle along the pads, at `height` m."""
        x, y, _ = center + self.offset + aside * np.cross((0.0, 0.0, -1.0), self.axis)
        return looking_down((float(x), float(y), height), self.axis)


def _closings(name: str, body: Upright, widest: float, *, needed: bool = True) -> list[_Closing]:
    """All that fit around the object; without any a `GraspError` if they are needed."""
    if body.narrowest + min(SIDE_ROOM) > widest:
        if not needed:
            return []
        raise GraspError(f"{name} is {body.narrowest * 1e3:.0f} mm wide, too wide for {widest * 1e3:.0f} mm")
    return [
        _Closing(sign * axis, width, across, opening, (cramped, longer))
        for axis, width, across, longer in around(body)
        if width + min(SIDE_ROOM) <= widest
        for cramped, opening in openings(width, widest)
        for sign in (1.0, -1.0)
    ]


def around(body: Upright) -> list[tuple[Array, float, float, int]]:
    """Horizontal axes (3,) along which the pads may close on the object, in the world.

    With each its width there (m), how long it is across (m; 0 where only the middle holds), and whether that is the
    longer side.
    """
    (x_axis, x), (y_axis, y) = body.sides
    if body.form.round:
        turns = (math.pi * k / _YAWS for k in range(_YAWS))
        return [(math.cos(turn) * x_axis + math.sin(turn) * y_axis, x, 0.0, 0) for turn in turns]
    one, other = ((x_axis, x, y, 0), (y_axis, y, x, 0 if body.is_square else 1))
    return [one, other] if x <= y else [(*other[:3], 0), (*one[:3], 0 if body.is_square else 1)]


def openings(width: float, widest: float) -> list[tuple[int, float]]:
    """How far (m) fingers open around a width (m), with how cramped they are then."""
    return list(enumerate(dict.fromkeys(min(width + room, widest) for room in SIDE_ROOM)))


def _rims(thing: Obstacle, body: Upright, wall: Wall, room: Room, widest: float) -> list[tuple[_Closing, Room]]:
    """Ways to hold a piece of a rim, one finger within; with the free space there, beside the rest of the thing."""
    axis = thing.pose.rotation_matrix @ wall.direction
    thickness, middle = wall.outer - wall.inner, (wall.outer + wall.inner) / 2
    x, y, z = (middle * axis).tolist()
    free = room.beside(parts_beside(thing, wall))
    return [
        (_Closing(sign * _level(axis), thickness, 0.0, opening, (cramped, 0), (x, y, z), AT_RIM), free)
        for cramped, opening in openings(thickness, widest)
        for sign in (1.0, -1.0)
    ]


def _heights(name: str, body: Upright, reach: float, throat: float) -> Array:
    """(n,) heights of the tool point (m, world) that are tried, the deepest first.

    Pads reach `reach` m beyond the tool point, and the object may reach `throat` m towards the palm.

    What the object stands on may not be known, so the pads keep away from its bottom as from what is known. Raises
    `GraspError` for an object that is too low for that.
    """
    ground = max(body.top - body.height + _GROUND + reach, body.top - throat)
    if body.form.rolls:  # it slips from pads that are not around its middle
        middle = float(body.center[2])
        deepest, highest = max(middle, ground), middle + reach - _PAST_MIDDLE
    else:
        deepest, highest = max(body.top - _DEPTH, ground), body.top - LEAST_HOLD + reach
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
        return Grasp(lowest, closing.opening, closing.width, (closing.way, 0, 0, *closing.rank)), ()
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
    return Grasp(tool, closing.opening, closing.width, (closing.way, 0, int(best > 0), *closing.rank)), ()


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
    step = math.pi / 4 if body.form.round else math.pi / 2 if body.is_square else math.pi
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
