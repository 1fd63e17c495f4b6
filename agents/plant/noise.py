"""The errors of a colour and depth camera, on top of an ideal picture.

Depth follows stereo: the disparity f B / z is measured with a small error that is alike over a patch, in steps
of a fraction of a pixel, so that the error of the depth grows with its square (Keselman et al., "Intel RealSense
Stereoscopic Depth Cameras", CVPR workshops 2017). An object's own error, given by the scenario, moves all its
points along their viewing rays.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scenario.format.scenario import SensorSpec
from dsr.vocabulary.intrinsics import Intrinsics

BASELINE = 0.055
"""m, between the two infrared cameras of a RealSense D415"""
DISPARITY_NOISE = 0.08
"""px, standard deviation"""
DISPARITY_STEP = 1 / 32
"""px, smallest step of the disparity that the depth camera measures"""
NEAREST, FARTHEST = 0.1, 4.0
"""m, the depths that the sensor can measure"""
EDGE_STEP = 0.02
"""m, least jump of the depth at which pixels drop out"""
EDGE_DROPOUT = 0.7
"""Share of the pixels at such a jump that drop out."""

_PATCH = 4  # px, over which the disparity's error is alike
_PATCH_GAIN = 1.25  # undoes what interpolation between patches takes from the standard deviation
_WIDEST = 6.0  # standard deviations, beyond which a table of noise has nothing

Color = NDArray[np.uint8]
Depth = NDArray[np.float32]


class SensorModel:
    """Errors of one camera, all drawn from `rng`.

    Args:
        spec: what the scenario says about the sensor.
        names: all objects; the systematic error of each is drawn at once.
        rng: source of all errors.
    """

    def __init__(self, spec: SensorSpec, names: Iterable[str], rng: np.random.Generator) -> None:
        self._spec = spec
        self._rng = rng
        self.bias = {name: float(rng.uniform(*spec.depth_bias)) for name in names}
        """m towards the camera, by object: the same in every frame"""

    @property
    def is_per_object(self) -> bool:
        """Whether objects have depth errors of their own."""
        return any(self._spec.depth_bias) or self._spec.depth_jitter > 0

    def errors(self) -> dict[str, float]:
        """How much nearer than it is (m, along the viewing ray) each object appears in the next frame."""
        jitter = self._rng.normal(0.0, self._spec.depth_jitter, len(self.bias))
        return {name: bias + float(extra) for (name, bias), extra in zip(self.bias.items(), jitter, strict=True)}

    def normal(self, count: int) -> NDArray[np.float64]:
        """The next `count` numbers of the standard normal distribution."""
        return self._rng.standard_normal(count)

    def color(self, image: Color) -> Color:
        """The image (h, w, 3) with the grey noise of the scenario, equal in all channels."""
        if self._spec.grey_noise == 0.0:
            return image
        drawn = self._rng.integers(0, 1 << 16, image.shape[:2], dtype=np.uint16)
        brighter, darker = (cv2.LUT(drawn, table) for table in _grey_noise(self._spec.grey_noise))
        brightened = cv2.add(image, cv2.merge([brighter] * 3))
        return np.asarray(cv2.subtract(brightened, cv2.merge([darker] * 3)), dtype=np.uint8)

    def depth(self, depth: Depth, intrinsics: Intrinsics) -> Depth:
        """The depth (h, w) m as such a sensor measures it, 0 where it cannot."""
        missing = np.asarray(cv2.bitwise_not(cv2.inRange(depth, NEAREST, FARTHEST)), np.uint8)
        self._drop_out(depth, missing)
        steps_at_1_m = np.float32(intrinsics.fx * BASELINE / DISPARITY_STEP)
        measured = np.maximum(depth, np.float32(NEAREST))
        np.divide(steps_at_1_m, measured, out=measured)
        measured += self._steps_off(depth.shape)
        np.maximum(np.rint(measured, out=measured), np.float32(1.0), out=measured)
        np.divide(steps_at_1_m, measured, out=measured)
        measured[missing > 0] = 0.0
        return measured

    def _steps_off(self, shape: tuple[int, ...]) -> Depth:
        """The error of the disparity, in steps of that."""
        height, width = shape
        small = self._rng.standard_normal((-(-height // _PATCH), -(-width // _PATCH)), dtype=np.float32)
        small *= np.float32(_PATCH_GAIN * DISPARITY_NOISE / DISPARITY_STEP)
        return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.float32)

    def _drop_out(self, depth: Depth, missing: NDArray[np.uint8]) -> None:
        """Let some of the pixels at jumps of the depth be missing (255), too."""
        jumps = cv2.morphologyEx(depth, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
        edges = np.flatnonzero(jumps > EDGE_STEP)
        missing.reshape(-1)[edges[self._rng.random(len(edges)) < EDGE_DROPOUT]] = 255


@functools.lru_cache(maxsize=8)
def _grey_noise(deviation: float) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """By how many grey levels each of 65536 equally likely numbers makes a pixel brighter, and by how many darker.

    The difference of both is normal with that standard deviation, rounded to whole levels.
    """
    most = min(math.ceil(_WIDEST * deviation), 255)
    levels, normal = np.arange(-most, most + 1), NormalDist(0.0, deviation)
    ends = np.rint([65536.0 * normal.cdf(level + 0.5) for level in levels[:-1].tolist()])
    noise = np.repeat(levels, np.diff(ends, prepend=0.0, append=65536.0).astype(np.int64))
    return noise.clip(0).astype(np.uint8), (-noise).clip(0).astype(np.uint8)


def shift_bodies(depth: Depth, bodies: NDArray[np.int32], errors: Mapping[int, float], intrinsics: Intrinsics) -> Depth:
    """The depth with each body of `errors` (m) brought nearer by that much along the viewing rays."""
    x, y = intrinsics.slopes()
    along_axis = 1 / np.sqrt(1 + x**2 + y**2)
    nearer = np.zeros_like(depth)
    for body, error in errors.items():
        nearer[bodies == body] = error
    return np.asarray(depth - nearer * along_axis, dtype=np.float32)
