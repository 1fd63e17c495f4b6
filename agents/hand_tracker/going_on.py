"""Hands that the model does not find any more, while all of their skin is in view: these go on where that is.

The model does not find every hand: not one that holds something, seen along its arm. Where model and outline both
show a hand, it is remembered how large the outline was, and where the palm was in that. An outline as large near there
later on is that hand. One that is smaller, or along something in front of it, is hidden in part: its middle tells
nothing of the palm then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.hand_tracker.sighting import MOST_TURN, OutlinedTip, SeenHand
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

_SAME = 0.1
"""m between the palms that model and outline have of one hand, at most: half its length"""
_AS_LARGE = 0.25
"""Share by which an outline may become larger or smaller with the view, and be that of the same hand"""
_MOST_SPEED = 1.0
"""m/s of a hand that goes on"""
_FORGOTTEN = 1.0
"""s without model and outline, after which nothing is known of a hand"""
_FINGERS = 5


class _Known(NamedTuple):
    """A hand as it was seen last, in the camera's frame."""

    stamp: float
    """s"""
    hand: SeenHand
    offset: Array
    """(3,) m, from the middle of the outline to the palm"""
    area: float
    """m^2, of the outline when the model found the hand, across the view"""


class GoingOn:
    """Keeps the hands of one camera that the model found, while their outlines go on."""

    def __init__(self) -> None:
        self._known: list[_Known] = []

    @property
    def waits(self) -> bool:
        """Whether there are hands that may go on."""
        return bool(self._known)

    def update(self, found: list[SeenHand], outlines: list[SeenHand], stamp: float) -> list[SeenHand]:
        """The hands that only their outlines show, in the camera's frame.

        Args:
            found: by the model, in the frame that was exposed at `stamp` (s).
            outlines: of skin, in the same frame.
            stamp: s.
        """
        free = [outline for outline in outlines if not any(_apart(outline.palm, hand.palm) < _SAME for hand in found)]
        known, going_on = [], []
        for before in self._known:
            if any(_apart(before.hand.palm, hand.palm) < _reach(before, stamp) for hand in found):
                continue
            outline = _nearest(before, free, stamp)
            if outline is not None:
                free.remove(outline)
                hand = _moved(before, outline)
                going_on.append(hand)
                known.append(before._replace(stamp=stamp, hand=hand))
            elif stamp - before.stamp <= _FORGOTTEN:
                known.append(before)
        for hand in found:
            near = min(outlines, key=lambda outline: _apart(outline.palm, hand.palm), default=None)
            if near is not None and near.outline is not None and _apart(near.palm, hand.palm) < _SAME:
                middle, area = near.outline
                known.append(_Known(stamp, hand, hand.palm.translation - middle, area))
        self._known = known
        return going_on


def _nearest(before: _Known, outlines: list[SeenHand], stamp: float) -> SeenHand | None:
    """The outline that is as large as a hand's was, the nearest; None if there is none where that can be."""
    place = before.hand.palm.translation - before.offset
    ways = [
        (float(np.linalg.norm(outline.outline.middle - place)), index)
        for index, outline in enumerate(outlines)
        if outline.outline is not None and abs(outline.outline.area - before.area) <= _AS_LARGE * before.area
    ]
    way, index = min(ways, default=(np.inf, -1))
    return outlines[index] if way < _reach(before, stamp) else None


def _moved(before: _Known, seen: SeenHand) -> SeenHand:
    """A hand with its palm where the outline is; its rotation, and which fingertips are whose, are not known anew."""
    unknown = np.full(_FINGERS, np.inf)
    middle = before.hand.palm.translation if seen.outline is None else seen.outline.middle
    return before.hand._replace(
        palm=Pose(middle + before.offset, before.hand.palm.q),
        tips={},
        turn_covariance=MOST_TURN**2 * np.eye(3),
        palm_sigma=seen.palm_sigma,
        outlined=tuple(OutlinedTip(tip, unknown) for tip in seen.tips.values()),
        begins=False,
    )


def _apart(one: Pose, other: Pose) -> float:
    """m, between two palms."""
    return float(np.linalg.norm(one.translation - other.translation))


def _reach(before: _Known, stamp: float) -> float:
    """m, that a hand may be from where it was."""
    return _SAME + _MOST_SPEED * max(stamp - before.stamp, 0.0)
