"""How far a body is on the way along which it is driven, and at which velocity it gets on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import CONFIRMED_IN, FASTEST_SEEN, SAME_PLACE
from simulation_handler.contact.placement import Placement
from simulation_handler.hands.state import HAND_REACH
from simulation_handler.motion.supported_objects import HALTED, Twist
from simulation_handler.perception.paths import Path, between, turn_between
from simulation_handler.scales import DIAGONAL
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject

CATCHING_UP = 0.25
"""m/s by which a body is faster than what it follows at most: what is in it is not thrown up"""
_REACTION = 0.03  # s in which a body makes up for being off its way
_NEARER = 0.015  # m that a stand must be nearer to what is seen than a lean that a hand tells, to be believed
_FASTEST_TURN = FASTEST_SEEN / HAND_REACH  # rad/s, of what a hand turns about its wrist


@dataclass
class Drive:
    """How far a body is on its way."""

    begun: float
    """s"""
    played: float
    """s, up to which it has followed the way"""
    begin: Pose
    """World_from_object where this step of the belief begins"""
    end: Pose
    """Likewise where it ends"""
    origin: Pose
    """Likewise where it has set out"""
    supports: tuple[str, ...] | None = None
    """What carries it there; None while that is not known"""
    by_hand: bool = False
    """A hand has held it since it rested"""
    runs: bool = False
    """It is out of sight, and physics alone moves it on"""
    still_since: float | None = None
    """s"""
    velocity: Twist = HALTED
    """m/s and rad/s, in the last step of physics"""
    speed: float = 0.0
    """m/s, as it was seen to move lately; what it pushes is not faster"""

    @property
    def rests(self) -> bool:
        """Whether something carries it there, as far as that is known."""
        return self.supports is None or bool(self.supports)


def goes_with_hand(item: BelievedObject, position: Vector3) -> bool:
    """Whether an object and the hand that holds it are both seen to have moved it from `position`, the same way."""
    if item.place_by_hand is None:
        return False
    by_hand, by_itself = np.subtract(item.place_by_hand, position), np.subtract(item.path.last.t, position)
    ways = float(np.linalg.norm(by_hand)), float(np.linalg.norm(by_itself))
    return min(ways) > SAME_PLACE and float(by_hand @ by_itself) > DIAGONAL * math.prod(ways)


def stands_or_leans(seen: Solid, leaning: Placement, stands: Sequence[Placement]) -> Placement:
    """The stand nearest to what is seen, unless the lean that a hand tells is as near and does not reach below it."""
    upright = min(stands, key=lambda stand: _shift(seen, stand), default=leaning)
    sunk = max(upright.solid.bottom - leaning.solid.bottom, 0.0)
    return upright if _shift(seen, upright) + _NEARER < _shift(seen, leaning) + sunk else leaning


def _shift(seen: Solid, placement: Placement) -> float:
    """Metres between where something is seen and where it can be."""
    return math.dist(seen.position, placement.solid.position)


def is_lifted(item: BelievedObject, drive: Drive) -> bool:
    """Whether an object is off what carried it by far less than percepts may be, because its hand is, too."""
    error = item.learned_error
    if item.place_by_hand is None or error is None or not error.is_known:
        return False
    height = min(item.place_by_hand[2], item.path.last.t[2]) - drive.begin.t[2]
    return not drive.rests or height > SAME_PLACE


def seen_speed(path: Path, time: float) -> float:
    """m/s at which something was seen to move up to that time (s), or a moment before."""
    places = [path.at(time - k * CONFIRMED_IN).t for k in range(3)]  # count of places: now and twice before
    return max(math.dist(a, b) for a, b in pairwise(places)) / CONFIRMED_IN


def towards(a: Pose, b: Pose, metres: float) -> Pose:
    """On the way from a to b, as far as that."""
    distance = math.dist(a.t, b.t)
    return b if distance <= metres else between(a, b, metres / distance)


def velocity_of(here: Pose, drive: Drive, share: float, seconds: float) -> Twist:
    """m/s and rad/s at which a body gets to where it should be after a share of a step of the belief."""
    there = between(drive.begin, drive.end, share)
    steady = [(b - a) / seconds for a, b in zip(drive.begin.t, drive.end.t, strict=True)]
    turning = [angle / seconds for angle in turn_between(drive.begin.q, drive.end.q)]
    off = [(b - a) / _REACTION for a, b in zip(here.t, there.t, strict=True)]
    askew = [angle / _REACTION for angle in turn_between(here.q, there.q)]
    linear = _limited([a + b for a, b in zip(steady, off, strict=True)], FASTEST_SEEN + CATCHING_UP)
    return linear, _limited([a + b for a, b in zip(turning, askew, strict=True)], _FASTEST_TURN)


def _limited(vector: list[float], most: float) -> Vector3:
    length = math.hypot(*vector)
    x, y, z = vector if length <= most else [most / length * a for a in vector]
    return x, y, z
