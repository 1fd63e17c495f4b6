"""What hand-eye calibration works on: where a target's points are in the images, and where the hand was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.batches import inverses
from dsr.math3d.transforms import Array


class HandNoise(NamedTuple):
    """One source of errors of the hand's poses: independent numbers of one standard deviation, and what they move."""

    name: str
    """For people, such as `joints`"""
    unit: str
    """`m` or `rad`, of the numbers"""
    effects: Array
    """(v, 6, k) the twist (m, rad) of the hand in its own frame by each of k numbers, in each of v views"""
    std: float
    """Its standard deviation as far as it is known beforehand"""
    is_stated: bool
    """Whether somebody stated the standard deviation: then it is the least, otherwise what is usual"""


@dataclass(frozen=True)
class Observations:
    """All views of one target.

    A camera in the hand looks at a target that is fixed to the base; otherwise the hand holds the target, and the
    camera is fixed to the base. *Carrier* is what the camera is fixed to, *holder* what the target is fixed to.
    """

    names: tuple[str, ...]
    """(v) names of the images"""
    hands: Array
    """(v, 4, 4) base_from_hand as the robot tells it"""
    pixels: Array
    """(v, n, 2) px; NaN of points that were not found"""
    points: Array
    """(n, 3) m, in the target's frame"""
    symmetries: NDArray[np.intp]
    """(s, n) orders of the points that look alike; the first is the identity"""
    noises: tuple[HandNoise, ...]
    joint_effects: Array | None
    """(v, 6, k) twist (m, rad) of the hand, in its frame, by constant errors of k joints; None if poses were told"""
    is_in_hand: bool
    size: tuple[int, int]
    """Width and height of the images, px"""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(v, n) which points were found"""
        return np.asarray(np.isfinite(self.pixels).all(axis=2))

    @property
    def holders(self) -> Array:
        """(v, 4, 4) carrier_from_holder as the robot tells it"""
        return inverses(self.hands) if self.is_in_hand else self.hands

    def subset(self, chosen: Sequence[int]) -> Observations:
        """Only the views with these numbers."""
        rows = list(chosen)
        return replace(
            self,
            names=tuple(self.names[row] for row in rows),
            hands=self.hands[rows],
            pixels=self.pixels[rows],
            noises=tuple(noise._replace(effects=noise.effects[rows]) for noise in self.noises),
            joint_effects=None if self.joint_effects is None else self.joint_effects[rows],
        )

    def reordered(self, orders: Sequence[int]) -> Observations:
        """With the points of each view in the order of the symmetry with that number."""
        pixels = [view[self.symmetries[order]] for view, order in zip(self.pixels, orders, strict=True)]
        return replace(self, pixels=np.array(pixels))


def pose_noises(hands: Array, position: float | None, rotation: float | None) -> tuple[HandNoise, ...]:
    """Errors of the hand's position (m) and rotation (rad) along and about each of its axes; None is not stated."""
    effects = np.zeros((2, len(hands), 6, 3))
    effects[0, :, :3] = effects[1, :, 3:] = np.eye(3)
    kinds = (("position", "m", position, USUAL_POSITION), ("rotation", "rad", rotation, USUAL_ROTATION))
    return tuple(
        HandNoise(name, unit, effect, usual if stated is None else stated, stated is not None)
        for effect, (name, unit, stated, usual) in zip(effects, kinds, strict=True)
    )


USUAL_POSITION = 5e-4
"""m, standard deviation of the hand's position where nobody states one: the usual accuracy of an industrial arm"""
USUAL_ROTATION = 5e-4
"""rad, likewise of its rotation: half a millimetre a metre away"""
