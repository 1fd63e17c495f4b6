"""How far apart two poses may be and still count as the same."""

from __future__ import annotations

from typing import NamedTuple

from dsr.math3d.transforms import Pose


class PoseTolerance(NamedTuple):
    """The largest distance and the largest rotation between two poses that count as the same."""

    metres: float
    """m between the origins"""
    radians: float
    """rad, angle of the rotation between the axes"""

    def covers(self, one: Pose, other: Pose) -> bool:
        """Whether two poses in the same frame differ by no more than this, noise or not."""
        metres, radians = one.distance(other)
        return metres <= self.metres and radians <= self.radians

    def scaled(self, factor: float) -> PoseTolerance:
        """A tolerance that is `factor` times as wide."""
        return PoseTolerance(factor * self.metres, factor * self.radians)


SAME_POSE = PoseTolerance(1e-6, 1e-6)
"""m, rad: what rounding makes of a pose that was written and read again"""
