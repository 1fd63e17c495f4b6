"""The state of each human hand: its percepts, the paths of palm and fingertips, and its grasps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import CONTACT_DELAY, ONE_MOMENT, PRESENT
from dsr.vocabulary.handling import Handling
from simulation_handler.hands.anatomy import HAND
from simulation_handler.hands.relation import COVERING, TAKING, Sign, after
from simulation_handler.perception.paths import Path

UNSEEN = PRESENT
"""s after its last percept, from which an object is where its hand has it, or pushes it."""
ELSEWHERE = 0.05
"""m, farther than a palm, of which a part is hidden, seems to go by itself, or than it goes while a hand closes.

An object that is seen so far from where its hand would have it is not in that hand as it was.
"""
HAND_REACH = HAND.reach + ELSEWHERE
"""m from palm or fingertips to what a hand may take or move: a finger's length, and the error of a half-hidden palm"""
FINGERS = len(HAND.fingers)
"""count of fingers: a hand of which so many are measured hides none"""
HALF = 0.5
"""1, share of what there is to see of an object, below which it counts as hidden"""


class HandPercept(NamedTuple):
    """The percept of a hand."""

    pose: Pose
    """world_from_hand, with stamp"""
    tips: Mapping[str, Pose]
    """Fingertips in the world by name, with stamps; their rotations say nothing."""
    perceived: bool
    """Whether the hand is in sight now."""


@dataclass
class Hand:
    """A human hand, and the paths that it took."""

    perceived: bool = False
    path: Path = field(default_factory=Path)
    tips: dict[str, Path] = field(default_factory=dict)

    def measures(self, tip: Path) -> bool:
        """Whether one of its fingertips is known as lately as its palm."""
        return tip.newest >= self.path.newest - ONE_MOMENT

    @property
    def measured(self) -> int:
        """Number of fingertips that are measured now."""
        return sum(self.measures(tip) for tip in self.tips.values())


@dataclass
class HandGrasp:
    """An object that a hand touches."""

    since: float
    """Begin of the grasp, s."""
    hand_from_object: Pose
    state: Handling = Handling.FREE
    """What they have to do with one another."""
    places: dict[str, Vector3] = field(default_factory=dict)
    """Places where fingertips touched the object while that could be seen, in the object's frame, m, by fingertip."""
    aloft: float = -math.inf
    """s, when it was last seen in the air with its hand, or nothing spoke against that."""
    sure: Pose | None = None
    """World_from_object while it is unseen, when fingertips that touch it, or a palm at rest, told that last."""
    opened: float = -math.inf
    """s, when the fingertips were last seen apart from the unseen object"""

    def __post_init__(self) -> None:
        self.met = self.hand_from_object.t
        """m, where the object was in the frame of the palm when the hand came to touch it."""

    @property
    def is_covered(self) -> bool:
        """Whether the hand covered the object: that it touches it is presumed, not seen."""
        return self.state in (COVERING, TAKING)

    def has_just_opened(self, stamp: float) -> bool:
        """Whether at `stamp` (s) it is not sure yet that fingertips, which were seen apart, touch the object again."""
        return stamp - self.opened <= CONTACT_DELAY

    def note(self, sign: Sign) -> None:
        """Take in evidence."""
        self.state = after(self.state, sign)

    def at_fingertips(self, fingertips: Mapping[str, Vector3], rotation: Quaternion) -> Vector3 | None:
        """Where (m) fingertips, which touched the object while that could be seen, have it if it is turned like that.

        None if none of them did. No rotation of the palm is needed, which is poor of a hand that is hidden in part.
        """
        shifts = [
            tuple(a - b for a, b in zip(point, quaternions.rotate(rotation, self.places[tip]), strict=True))
            for tip, point in fingertips.items()
            if tip in self.places
        ]
        if not shifts:
            return None
        x, y, z = (sum(values) / len(shifts) for values in zip(*shifts, strict=True))
        return x, y, z
