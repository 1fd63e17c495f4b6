"""Distortion of a lens: where a viewing ray meets the image plane, and back; models and coefficients as in OpenCV.

Points are in normalised coordinates: (x / z, y / z) of a point before the camera, before focal length and centre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from dsr.math3d.transforms import Array

LensModel = Literal["plumb_bob", "rational_polynomial", "equidistant"]

_COUNTS: dict[str, tuple[int, ...]] = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
}
"""Numbers of coefficients that a model may have."""
_STEP = 1e-6
"""Normalised coordinates, half the width of the central differences: errors of 1e-12 on functions of size 1."""
_CLOSE = 1e-10
"""Normalised coordinates, a thousandth of a thousandth of a pixel: Newton's method has arrived."""
_ITERATIONS = 20
"""Of Newton's method, which doubles its digits in each."""
_STEEPEST = math.radians(89.0)
"""rad off the axis: a ray with z = 1 hardly goes beyond."""
_SAMPLES = 4096
"""Of the radial curve, one in 0.02 degrees."""
MOST_COEFFICIENTS = 14
"""Coefficients of OpenCV's largest model: rational, thin prism and tilt"""


class Distortion(msgspec.Struct, frozen=True):
    """How a lens distorts images (Brown 1966 with Conrady's terms; Kannala and Brandt 2006 for fisheye lenses)."""

    model: LensModel
    """`plumb_bob`: radial and tangential; `rational_polynomial`: a quotient of polynomials, then thin prism and
    tilt; `equidistant`: a fisheye lens. Names as in `sensor_msgs/CameraInfo`."""
    coefficients: tuple[float, ...]
    """Without unit, in the order of OpenCV: k1, k2, p1, p2, k3, ...; of `equidistant` k1 to k4"""

    @staticmethod
    def of(model: object, coefficients: Sequence[object]) -> Distortion:
        """What a node, a frame or a message tells. Raises `ValueError` for what no lens has."""
        try:
            found = msgspec.convert({"model": model, "coefficients": coefficients}, Distortion)
        except msgspec.ValidationError as error:
            raise ValueError(f"distortion {str(model)[:80]!r}: {error}") from error
        if len(found.coefficients) not in _COUNTS[found.model] or not all(map(math.isfinite, found.coefficients)):
            allowed = " or ".join(map(str, _COUNTS[found.model]))
            raise ValueError(f"{len(coefficients)} coefficients of {model}: expected {allowed} finite numbers")
        return found

    def distort(self, points: Array) -> Array:
        """(..., 2) where the lens shows points (..., 2).

        Far off the axis a polynomial turns back, and would show there what is beyond the edge of the image: points
        beyond that radius are NaN.
        """
        squared = (points * points).sum(axis=-1)
        if self.model == "equidistant":
            shown = points * _fisheye(squared, self.coefficients)[..., None]
        else:
            shown = _polynomial(points, squared, self.coefficients)
        return np.where((squared <= _radial_curve(self).radii[-1] ** 2)[..., None], shown, np.nan)

    def derivative(self, points: Array) -> Array:
        """(..., 2, 2) of `distort` by its points, by central differences."""
        steps = _STEP * np.eye(2)
        moved = self.distort(points[..., None, :] + steps) - self.distort(points[..., None, :] - steps)
        return np.asarray(np.swapaxes(moved, -1, -2) / (2.0 * _STEP))

    def undistort(self, points: Array) -> Array:
        """(..., 2) which points the lens shows at points (..., 2); NaN where it shows none.

        Newton's method starts where the radial part alone would show each point.
        """
        wanted = np.asarray(points, np.float64)
        curve, radius = _radial_curve(self), np.linalg.norm(wanted, axis=-1)
        start = np.interp(radius, curve.shown, curve.radii, right=np.nan) / np.maximum(radius, _CLOSE)
        found = wanted * np.where(radius > _CLOSE, start, 1.0)[..., None]
        for _ in range(_ITERATIONS):
            off = self.distort(found) - wanted
            if not (np.abs(off) > _CLOSE).any():
                break
            found = found - _solved(self.derivative(found), off)
        arrived = np.asarray((np.abs(self.distort(found) - wanted) <= _CLOSE).all(axis=-1))
        return np.where(arrived[..., None], found, np.nan)


class _RadialCurve(NamedTuple):
    """How far from the axis a lens shows what is how far from it, as long as farther is shown farther."""

    radii: Array
    """(n,) of points"""
    shown: Array
    """(n,) of where they are shown, without tangential parts; increasing"""


@lru_cache(maxsize=64)
def _radial_curve(distortion: Distortion) -> _RadialCurve:
    radii = np.tan(np.linspace(0.0, _STEEPEST, _SAMPLES))
    squared = radii * radii
    factor = _fisheye if distortion.model == "equidistant" else _radial
    with np.errstate(over="ignore", invalid="ignore"):  # of coefficients that no lens has
        shown = radii * factor(squared, distortion.coefficients)
        falling = np.flatnonzero(~(np.diff(shown) > 0.0))
    end = int(falling[0]) + 1 if len(falling) else _SAMPLES
    return _RadialCurve(radii[:end], shown[:end])


def _radial(squared: Array, coefficients: Sequence[float]) -> Array:
    """The factor of the radial terms, of points whose squared distances from the axis are given."""
    k1, k2, _, _, k3, k4, k5, k6 = _filled(coefficients)[:8]
    above = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
    below = 1.0 + squared * (k4 + squared * (k5 + squared * k6))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.asarray(above / below)


def _polynomial(points: Array, squared: Array, coefficients: Sequence[float]) -> Array:
    """All terms of OpenCV's pinhole model: radial, tangential, thin prism, tilt."""
    _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, tilt_x, tilt_y = _filled(coefficients)
    x, y = points[..., 0], points[..., 1]
    factor = _radial(squared, coefficients)
    shown_x = x * factor + 2.0 * p1 * x * y + p2 * (squared + 2.0 * x * x) + squared * (s1 + squared * s2)
    shown_y = y * factor + p1 * (squared + 2.0 * y * y) + 2.0 * p2 * x * y + squared * (s3 + squared * s4)
    shown = np.stack([shown_x, shown_y], axis=-1)
    return _tilted(shown, tilt_x, tilt_y) if tilt_x or tilt_y else shown


def _tilted(points: Array, tilt_x: float, tilt_y: float) -> Array:
    """Points on a sensor that is turned by angles (rad) about x, then y (Scheimpflug), as OpenCV defines them."""
    cos_x, sin_x, cos_y, sin_y = math.cos(tilt_x), math.sin(tilt_x), math.cos(tilt_y), math.sin(tilt_y)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, sin_x], [0.0, -sin_x, cos_x]])
    about_y = np.array([[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]])
    turned = about_y @ about_x
    onto = np.array([[turned[2, 2], 0.0, -turned[0, 2]], [0.0, turned[2, 2], -turned[1, 2]], [0.0, 0.0, 1.0]])
    shown = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ (onto @ turned).T
    return np.asarray(shown[..., :2] / shown[..., 2:])


def _fisheye(squared: Array, coefficients: Sequence[float]) -> Array:
    """The factor of a fisheye lens, of points whose squared distances from the axis are given."""
    radius = np.maximum(np.sqrt(squared), _CLOSE)
    angle = np.arctan(radius)
    power = angle * angle
    k1, k2, k3, k4 = coefficients
    return np.asarray(angle * (1.0 + power * (k1 + power * (k2 + power * (k3 + power * k4)))) / radius)


def _filled(coefficients: Sequence[float]) -> tuple[float, ...]:
    return (*coefficients, *(0.0,) * (MOST_COEFFICIENTS - len(coefficients)))


def _solved(matrices: Array, vectors: Array) -> Array:
    """(..., 2) the solutions of linear equations with matrices (..., 2, 2); NaN where there is none."""
    a, b, c, d = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 0], matrices[..., 1, 1]
    u, v = vectors[..., 0], vectors[..., 1]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.asarray(np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None])
