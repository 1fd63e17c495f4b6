"""Intrinsics of a camera: how points before it come into its image, and back."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dsr.graph.elements import Node
from dsr.math3d.transforms import Array
from dsr.vocabulary.distortion import MOST_COEFFICIENTS, Distortion

INTRINSICS = ("fx", "fy", "cx", "cy", "width", "height", "distortion_model", "distortion")
"""Attributes of a camera's node that tell them."""
_PINHOLE, _LENS = INTRINSICS[:6], INTRINSICS[6:]
_MOST_PIXELS = 1e5
"""px, no focal length, principal point or edge of an image is beyond."""
_LARGER = 3.0
"""Times that the picture of an ideal camera may be wider or higher: none can hold all that a fisheye lens sees."""
_BORDER = 65
"""Pixels of each edge of an image that are looked at to find how far the camera sees."""


class Intrinsics(msgspec.Struct, frozen=True):
    """A camera with one centre of projection; pixel (0, 0) is centred on the upper left one."""

    fx: float
    fy: float
    """px, focal lengths"""
    cx: float
    cy: float
    """px, principal point"""
    width: int
    height: int
    """px, of the image"""
    distortion: Distortion | None = None
    """Of the lens; None of an ideal pinhole, and of images that were rectified"""

    @staticmethod
    def from_fov(width: int, height: int, fov: float) -> Intrinsics:
        """Square pixels, the axis through the middle; `fov` is the horizontal field of view in rad."""
        focal = width / 2 / float(np.tan(fov / 2))
        return Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    @staticmethod
    def from_meta(meta: Mapping[str, float | int | str], shape: tuple[int, ...]) -> Intrinsics:
        """Those that a frame with images of `shape` (height, width, ...) tells beside them, see `meta`.

        Raises:
            ValueError: if one is missing, or no camera has such ones.
        """
        missing = [name for name in INTRINSICS[:4] if not _is_number(meta.get(name))]
        if missing:
            raise ValueError(f"intrinsics {', '.join(missing)} missing; expected numbers fx, fy, cx, cy in px")
        fx, fy, cx, cy = values = tuple(float(meta[name]) for name in INTRINSICS[:4])
        if not (min(fx, fy) >= 1.0 and all(abs(value) <= _MOST_PIXELS for value in values)):
            raise ValueError(f"intrinsics {values}: expected fx, fy >= 1 px and none beyond {_MOST_PIXELS} px")
        if max(shape[:2]) > _MOST_PIXELS:
            raise ValueError(f"images of {shape[1]} x {shape[0]} px: none is larger than {_MOST_PIXELS} px")
        model = meta.get("distortion_model")
        coefficients = [meta[name] for name in map("d{}".format, range(1, MOST_COEFFICIENTS + 1)) if name in meta]
        lens = Distortion.of(model, coefficients) if model else None
        return Intrinsics(fx, fy, cx, cy, shape[1], shape[0], lens)

    def meta(self) -> dict[str, float | int | str]:
        """What a frame tells beside its images: fx, fy, cx, cy in px; of a lens distortion_model and d1, d2, ..."""
        told: dict[str, float | int | str] = {name: getattr(self, name) for name in INTRINSICS[:4]}
        if self.distortion is not None:
            told["distortion_model"] = self.distortion.model
            told |= {f"d{number}": value for number, value in enumerate(self.distortion.coefficients, 1)}
        return told

    def attributes(self) -> dict[str, Any]:
        """What the node of a camera tells; of a camera without a lens the model is empty."""
        model, coefficients = ("", ()) if self.distortion is None else msgspec.structs.astuple(self.distortion)
        told = {name: getattr(self, name) for name in _PINHOLE}
        return told | dict(zip(_LENS, (model, coefficients), strict=True))

    @property
    def matrix(self) -> Array:
        """(3, 3) camera matrix, px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) m in the optical frame (z forward, x right, y down), with z > 0.

        NaN of points that a distorting lens shows nowhere.
        """
        return self._pixels(points[..., :2] / points[..., 2:])

    def project_with_derivative(self, points: Array) -> tuple[Array, Array]:
        """Pixels (..., 2) of points (..., 3) m, and their derivatives (..., 2, 3) px/m by the points."""
        flat = points[..., :2] / points[..., 2:]
        unit = np.broadcast_to(np.eye(2), (*flat.shape, 2))
        by_point = np.concatenate([unit, -flat[..., None]], axis=-1) / points[..., 2, None, None]
        if self.distortion is not None:
            by_point = self.distortion.derivative(flat) @ by_point
        return self._pixels(flat), np.asarray(by_point * np.array([[self.fx], [self.fy]]))

    def rays(self, pixels: Array) -> Array:
        """Viewing rays (..., 3) with z = 1 through pixels (..., 2); NaN where a distorting lens shows nothing."""
        flat = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        if self.distortion is not None:
            flat = self.distortion.undistort(flat)
        return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)

    def slopes_at(self, u: NDArray[np.int64], v: NDArray[np.int64]) -> tuple[Array, Array]:
        """The x and the y (n,) of the viewing rays with z = 1 through pixels in columns u (n,) and rows v (n,)."""
        if self.distortion is None:
            return np.asarray((u - self.cx) / self.fx), np.asarray((v - self.cy) / self.fy)
        rays = self.rays(np.column_stack([u, v]).astype(np.float64))
        return rays[:, 0], rays[:, 1]

    def slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The x and the y of the viewing rays with z = 1 of all pixels: arrays that broadcast to (height, width)."""
        return _slopes(self)

    def pinhole(self) -> Intrinsics:
        """An ideal camera with the same centre, axes and focal lengths, whose picture holds what this one sees.

        The picture is as large as that needs, `_LARGER` times as wide and high at most.
        """
        return self if self.distortion is None else _pinhole(self)

    def _pixels(self, flat: Array) -> Array:
        """(..., 2) px of points (..., 2) in the plane with z = 1."""
        shown = flat if self.distortion is None else self.distortion.distort(flat)
        pixels: Array = shown * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


@lru_cache(maxsize=16)
def _slopes(intrinsics: Intrinsics) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    columns, rows = np.arange(intrinsics.width, dtype=np.float64), np.arange(intrinsics.height, dtype=np.float64)
    if intrinsics.distortion is None:
        x = ((columns - intrinsics.cx) / intrinsics.fx)[None, :]
        y = ((rows - intrinsics.cy) / intrinsics.fy)[:, None]
    else:
        rays = intrinsics.rays(np.stack(np.meshgrid(columns, rows), axis=-1))
        x, y = rays[..., 0], rays[..., 1]
    found = x.astype(np.float32), y.astype(np.float32)
    for slopes in found:
        slopes.flags.writeable = False
    return found


@lru_cache(maxsize=64)
def _pinhole(intrinsics: Intrinsics) -> Intrinsics:
    edges = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    size, focal = np.array([intrinsics.width, intrinsics.height]), np.array([intrinsics.fx, intrinsics.fy])
    border = np.concatenate([np.linspace(edges[k], edges[k + 1], _BORDER) for k in range(4)]) * (size - 1)
    outwards = np.copysign(np.inf, border - (intrinsics.cx, intrinsics.cy))
    rays = intrinsics.rays(border)[:, :2]
    shown = np.where(np.isfinite(rays), rays, outwards) * focal
    most = 0.5 * _LARGER * size
    first, last = np.floor(shown.min(axis=0).clip(-most, 0)), np.ceil(shown.max(axis=0).clip(0, most))
    width, height = (last - first + 1).astype(int).tolist()
    return Intrinsics(intrinsics.fx, intrinsics.fy, float(-first[0]), float(-first[1]), width, height)


def read_intrinsics(camera: Node) -> Intrinsics | None:
    """Read the intrinsics of a camera's node; None if a value is missing, or no camera can have it."""
    values: dict[str, Any] = {name: camera.get(name) for name in _PINHOLE}
    if None in values.values():
        return None
    model, coefficients = (camera.get(name) for name in _LENS)
    try:
        found = Intrinsics(**values, distortion=Distortion.of(model, coefficients or ()) if model else None)
    except ValueError:
        return None
    is_possible = min(found.fx, found.fy, found.width, found.height) > 0
    return found if is_possible and max(found.width, found.height) <= _MOST_PIXELS else None
