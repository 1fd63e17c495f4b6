"""The noise of percepts: one model, which every agent that weighs percepts configures alike."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Deviation = Annotated[float, msgspec.Meta(ge=0)]

NOTHING_SEEN = 0.05
"""1, share of its tag or image up to which an object cannot be seen: so far off is what is worked out from shapes"""

_EYE = np.eye(3)
_HORIZONTAL = np.diag((1.0, 1.0, 0.0))


class PerceptNoise(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Standard deviations of percepts, beside their own covariance. Base of the configurations of agents.

    The defaults are for an RGB-D camera at 0.3 to 1 m, whose depth is off by 5 to 15 mm, always alike for one object.
    """

    depth_bias: Deviation = 0.010
    """m along the viewing ray: the systematic error of depth, which averaging does not remove"""
    position_noise: Deviation = 0.001
    """m in each direction, added to each percept"""
    depth_noise: Deviation = 0.003
    """m along the viewing ray, added to each percept: depth errors of a frame are common to all pixels of an object"""
    learned_bias: Deviation = depth_noise
    """m along the viewing ray: what is left of the systematic error once it was learned, even from single percepts"""
    rotation_noise: Deviation = 0.01
    """rad about each axis, added to each percept"""
    tilt_noise: Deviation = 0.04
    """rad about horizontal axes, added to each percept: perception knows the tilt least well"""

    def position_covariance(self, own: Array, ray: Array | None = None) -> Array:
        """Covariance of a percept's position in the world frame.

        Args:
            own: (..., 3, 3) m^2, by the percept itself.
            ray: (..., 3) unit vector of the viewing ray in the world frame; None leaves the noise of depth out.

        Returns:
            (..., 3, 3) m^2, without the systematic error.
        """
        covariance = own + self.position_noise**2 * _EYE
        return covariance if ray is None else covariance + self.depth_noise**2 * (ray[..., :, None] * ray[..., None, :])

    def rotation_covariance(self, own: Array) -> Array:
        """Covariance (..., 3, 3) rad^2 of a percept's rotation in the world frame, z upwards.

        Args:
            own: (..., 3, 3) rad^2, by the percept itself.
        """
        return own + self.rotation_noise**2 * _EYE + self.tilt_noise**2 * _HORIZONTAL
