"""The errors of a colour and depth camera, on top of an ideal picture.

Depth follows stereo: the disparity f B / z is measured with a small error that is alike over a patch, in steps
of a fraction of a pixel, so that the error of the depth grows with its square (Keselman et al., "Intel RealSense
Stereoscopic Depth Cameras", CVPR workshops 2017). An object's own error, given by the scenario, moves all its
points along their viewing rays.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

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
        noise = self._rng.standard_normal(image.shape[:2], dtype=np.float32) * np.float32(self._spec.grey_noise)
        grey = np.rint(noise).astype(np.int16)
        return np.asarray(cv2.add(image, cv2.merge([grey, grey, grey]), dtype=cv2.CV_8U), dtype=np.uint8)

    def depth(self, depth: Depth, intrinsics: Intrinsics) -> Depth:
        """The depth (h, w) m as such a sensor measures it, 0 where it cannot."""
        missing = (depth < NEAREST) | (depth > FARTHEST) | self._dropouts(depth)
        scale = np.float32(intrinsics.fx * BASELINE)
        disparity = scale / np.maximum(depth, np.float32(NEAREST)) + self._disparity_error(depth.shape)
        measured = scale / (np.maximum(np.rint(disparity / DISPARITY_STEP), 1) * DISPARITY_STEP)
        return np.where(missing, np.float32(0.0), measured).astype(np.float32)

    def _disparity_error(self, shape: tuple[int, ...]) -> Depth:
        height, width = shape
        small = self._rng.standard_normal((-(-height // _PATCH), -(-width // _PATCH)), dtype=np.float32)
        error = cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
        return np.asarray(error * np.float32(_PATCH_GAIN * DISPARITY_NOISE), dtype=np.float32)

    def _dropouts(self, depth: Depth) -> NDArray[np.bool_]:
        """Some of the pixels at jumps of the depth."""
        kernel = np.ones((3, 3), np.uint8)
        edges = cv2.dilate(depth, kernel) - cv2.erode(depth, kernel) > EDGE_STEP
        dropped = np.zeros(depth.shape, bool)
        dropped[edges] = self._rng.random(int(edges.sum())) < EDGE_DROPOUT
        return dropped


def shift_bodies(depth: Depth, bodies: NDArray[np.int32], errors: Mapping[int, float], intrinsics: Intrinsics) -> Depth:
    """The depth with each body of `errors` (m) brought nearer by that much along the viewing rays."""
    x, y = intrinsics.slopes()
    along_axis = 1 / np.sqrt(1 + x**2 + y**2)
    nearer = np.zeros_like(depth)
    for body, error in errors.items():
        nearer[bodies == body] = error
    return np.asarray(depth - nearer * along_axis, dtype=np.float32)
