"""What is known of the common parameters before any image is seen: how far lenses, prints and joints are off."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agents.calibrator.hand_eye.model import FIXED, Parameters, ViewModel, lens_numbers
from dsr.math3d.transforms import Array

_FOCAL = 0.5
"""Standard deviation of a focal length, over itself"""
_ASPECT = 0.005
"""Standard deviation of fx / fy: pixels of today's sensors are square"""
_CENTRE = 0.1
"""Standard deviation of the principal point over the width of the image: some sensors are cropped to one side"""
_COEFFICIENT = 0.3
"""Standard deviation of a radial coefficient, which has no unit: wide lenses have about that"""
_TANGENTIAL = 0.01
"""Standard deviation of a tangential or prism coefficient: lens and sensor are parallel to about a degree"""
_NOT_RADIAL = (2, 3, 8, 9, 10, 11, 12, 13)
"""Places of the coefficients of OpenCV's models that are not radial"""


class Prior(NamedTuple):
    """A normal distribution of the common parameters; the mount and the target have none."""

    centre: Array
    """(c,)"""
    information: Array
    """(c, c)"""

    def off(self, now: Parameters, model: ViewModel) -> Array:
        """(c,) parameters minus their mean; 0 for the mount and the target."""
        return values(now, model) - self.centre


def values(now: Parameters, model: ViewModel) -> Array:
    """(c,) the common parameters; 0 for the mount and the target, of which only steps are numbers."""
    parts = [np.zeros(FIXED - 1), np.array([now.scale])]
    if model.fits_lens:
        parts.append(lens_numbers(now.intrinsics))
    if model.fits_offsets:
        parts.append(now.offsets)
    return np.concatenate(parts)


def prior_of(model: ViewModel, start: Parameters, size_std: float, offset_std: float) -> Prior:
    """What is known beforehand; a start tells the usual focal length and principal point.

    Args:
        model: says what is unknown.
        start: its intrinsics are where the lens is searched.
        size_std: standard deviation of the target's true over its told size.
        offset_std: rad or m, of the constant error of a joint.
    """
    centre = values(start, model)
    centre[FIXED - 1] = 0.0
    information = np.zeros((len(centre), len(centre)))
    information[FIXED - 1, FIXED - 1] = size_std**-2
    at = FIXED
    if model.fits_lens:
        count = len(lens_numbers(start.intrinsics))
        information[at : at + count, at : at + count] = _of_lens(start, count)
        centre[at + 4 : at + count] = 0.0
        at += count
    if model.fits_offsets:
        centre[at:] = 0.0
        information[at:, at:] = np.eye(len(centre) - at) * offset_std**-2
    return Prior(centre, information)


def _of_lens(start: Parameters, count: int) -> Array:
    focal, width = start.intrinsics.fx, start.intrinsics.width
    lens = start.intrinsics.distortion
    stds = np.full(count, _COEFFICIENT)
    stds[:4] = [_FOCAL * focal] * 2 + [_CENTRE * width] * 2
    if lens is not None and lens.model != "equidistant":
        stds[[4 + place for place in _NOT_RADIAL if 4 + place < count]] = _TANGENTIAL
    information = np.diag(stds**-2.0)
    information[:2, :2] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / (_ASPECT * focal) ** 2
    return information
