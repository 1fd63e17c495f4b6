"""A small ray tracer of tagged cubes on a table: exact geometry, then camera noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dsr.images.blobs import Frame
from dsr.math3d.boxes import CORNERS
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.tags import TAG_RATIO

Array = NDArray[np.float64]

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
SUPERSAMPLING = 3
TEXELS = 20
PATCH_GAIN = 1.25
"""Undoes what interpolation between patches takes from the standard deviation."""


@dataclass(frozen=True)
class Camera:
    """A noisy colour and depth camera; the defaults are those of a RealSense at 640 x 480."""

    width: int = 640
    height: int = 480
    focal: float = 615.0
    grey_noise: float = 2.0
    disparity_noise: float = 0.08
    baseline: float = 0.055
    patch: int = 4
    """px, over which depth errors are alike"""
    meta: dict[str, float | int | str] = field(init=False)

    def __post_init__(self) -> None:
        cx, cy = (self.width - 1) / 2, (self.height - 1) / 2
        object.__setattr__(self, "meta", {"fx": self.focal, "fy": self.focal, "cx": cx, "cy": cy})

    @property
    def intrinsics(self) -> Intrinsics:
        """As of its frames."""
        return Intrinsics.from_meta(self.meta, (self.height, self.width))

    def frame(
        self,
        cubes: dict[int, Pose],
        rng: np.random.Generator,
        *,
        size: float = 0.04,
        tag_ratio: float = TAG_RATIO,
        bias: float = 0.0,
        stamp: float = 0.0,
    ) -> Frame:
        """What the camera sees of cubes (`camera_from_cube` by marker id); depths too small by `bias` m."""
        color = np.full((self.height, self.width), 120.0)
        depth = np.full((self.height, self.width), 3.0)
        for marker_id, camera_from_cube in cubes.items():
            self._draw(color, depth, marker_id, camera_from_cube, size, tag_ratio, bias)
        color = np.clip(color + rng.normal(0.0, self.grey_noise, color.shape), 0, 255)
        inverse_noise = self.disparity_noise / (self.focal * self.baseline)
        depth = 1.0 / (1.0 / depth + inverse_noise * self._patchy(rng))
        rgb = np.repeat(np.round(color).astype(np.uint8)[..., None], 3, axis=2)
        return Frame(stamp, {"color": rgb, "depth": depth.astype(np.float32)}, dict(self.meta))

    def _patchy(self, rng: np.random.Generator) -> Array:
        """(h, w) unit noise that is alike over patches, as stereo matching makes it."""
        if self.patch == 1:
            return rng.normal(size=(self.height, self.width))
        small = rng.normal(size=(-(-self.height // self.patch), -(-self.width // self.patch)))
        smooth = cv2.resize(small, (self.width, self.height), interpolation=cv2.INTER_CUBIC)
        return np.asarray(PATCH_GAIN * smooth)

    def _draw(
        self, color: Array, depth: Array, marker_id: int, pose: Pose, size: float, ratio: float, bias: float
    ) -> None:
        pixels = self.intrinsics.project(pose.apply(CORNERS * size / 2))
        low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, [self.width, self.height])
        steps = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
        u = (np.arange(low[0], high[0])[:, None] + steps).ravel()
        v = (np.arange(low[1], high[1])[:, None] + steps).ravel()
        pixels = np.stack(np.meshgrid(u, v), axis=-1)
        rays = self.intrinsics.rays(pixels)
        distance, grey = _trace(rays, marker_id, pose, size, ratio)
        shape = (high[1] - low[1], SUPERSAMPLING, high[0] - low[0], SUPERSAMPLING)
        hit = np.isfinite(distance)
        region = np.s_[low[1] : high[1], low[0] : high[0]]
        coverage = hit.reshape(shape).mean(axis=(1, 3))
        shade = np.where(hit, grey, 0.0).reshape(shape).mean(axis=(1, 3))
        color[region] = shade + (1 - coverage) * color[region]
        middle = SUPERSAMPLING // 2
        centre = distance.reshape(shape)[:, middle, :, middle]
        depth[region] = np.where(np.isfinite(centre), centre - bias, depth[region])


def _trace(rays: Array, marker_id: int, pose: Pose, size: float, ratio: float) -> tuple[Array, Array]:
    """Depth z (m, infinite where missed) and grey value of each camera ray (..., 3) with z = 1."""
    origin = pose.inverse().translation
    directions = rays @ pose.rotation_matrix
    with np.errstate(divide="ignore"):
        planes = (np.array([[-size / 2], [size / 2]]) - origin)[:, None, None, :] / directions
    enter = planes.min(axis=0)
    near, far = enter.max(axis=-1), planes.max(axis=0).min(axis=-1)
    distance = np.where((near < far) & (near > 0), near, np.inf)
    top = (enter.argmax(axis=-1) == 2) & (directions[..., 2] < 0)
    point = origin + np.where(np.isfinite(distance), near, 0.0)[..., None] * directions
    return distance, np.where(top, _face(marker_id, point[..., :2] / (size * ratio)), 70.0)


def _face(marker_id: int, place: Array) -> Array:
    """Grey of the tagged face; `place` in tag sides from its centre, x right and y up."""
    image = cv2.aruco.generateImageMarker(DICTIONARY, marker_id, 10 * TEXELS).astype(float)
    column = np.floor((place[..., 0] + 0.5) * len(image)).astype(int)
    row = np.floor((0.5 - place[..., 1]) * len(image)).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < len(image)) & (row < len(image))
    picked = image[np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.where(inside, 30.0 + picked * 0.75, 220.0)


def facing(distance: float, tilt: float, rng: np.random.Generator, *, spread: float = 0.2) -> Pose:
    """A random `camera_from_cube` at `distance` m whose +z face is tilted `tilt` rad off the viewing ray."""
    ray = np.append(rng.uniform(-spread, spread, 2), 1.0)
    ray /= np.linalg.norm(ray)
    azimuth = rng.uniform(0, 2 * np.pi)
    axis = np.cross(ray, [np.cos(azimuth), np.sin(azimuth), 0.0])
    flipped, _ = Rotation.align_vectors([-ray], [[0.0, 0.0, 1.0]])
    tilted = Rotation.from_rotvec(tilt * axis / np.linalg.norm(axis)) * flipped
    rotation = tilted * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    return Pose(tuple(distance * ray), tuple(rotation.as_quat()))
