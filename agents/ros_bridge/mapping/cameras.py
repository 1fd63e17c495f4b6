"""`sensor_msgs/CameraInfo`, and the intrinsics of a camera with its distortion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from msgspec.structs import replace

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import to_header
from agents.ros_bridge.messages.types import RosTypes
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"


def read_camera_info(message: Any, *, rectified: bool = False) -> Intrinsics:
    """The intrinsics that a CameraInfo tells for its image, with the distortion of the lens, if there is any.

    Args:
        message: the CameraInfo. Its matrices are about the full image, of which the published one is a part
            (`roi`), made smaller (`binning`).
        rectified: of the images that image_proc made (`image_rect`): by the matrix `p`, and without distortion.

    Raises:
        RosMessageError: for a camera that was never calibrated, a lens whose model is not known, or numbers that no
            camera has.
    """
    pinhole = read_pinhole(message, rectified=rectified)
    return pinhole if rectified else replace(pinhole, distortion=read_lens(message))


def read_pinhole(message: Any, *, rectified: bool = False) -> Intrinsics:
    """The intrinsics without the distortion, which may be malformed; otherwise as `read_camera_info`."""
    matrix = np.asarray(message.p).reshape(3, 4) if rectified else np.asarray(message.k).reshape(3, 3)
    binning = max(1, message.binning_x), max(1, message.binning_y)
    roi = message.roi
    shape = (roi.height or message.height) // binning[1], (roi.width or message.width) // binning[0]
    meta = {
        "fx": float(matrix[0, 0]) / binning[0],
        "fy": float(matrix[1, 1]) / binning[1],
        "cx": (float(matrix[0, 2]) - roi.x_offset) / binning[0],
        "cy": (float(matrix[1, 2]) - roi.y_offset) / binning[1],
    }
    if not all(map(math.isfinite, meta.values())) or meta["fx"] == 0.0 or min(shape) < 1:
        raise RosMessageError("a CameraInfo without intrinsics: the camera was not calibrated")
    try:
        return Intrinsics.from_meta(meta, shape)
    except ValueError as error:
        raise RosMessageError(f"a CameraInfo: {error}") from error


def read_lens(message: Any) -> Distortion | None:
    """The distortion that a CameraInfo tells; None without any. Raises `RosMessageError` for numbers no lens has."""
    coefficients = tuple(np.asarray(message.d, np.float64).tolist())
    try:
        distorted = message.distortion_model and any(coefficients)
        return Distortion.of(message.distortion_model, coefficients) if distorted else None
    except ValueError as error:
        raise RosMessageError(f"a CameraInfo: {error}") from error


def to_camera_info(types: RosTypes, stamp: float, frame: str, intrinsics: Intrinsics) -> Any:
    """A CameraInfo of a camera that stands alone: its rectified image has the same matrix."""
    distortion = intrinsics.distortion
    k = intrinsics.matrix
    p = np.zeros((3, 4))
    p[:, :3] = k
    return types.new(
        CAMERA_INFO, header=to_header(types, stamp, frame), height=intrinsics.height, width=intrinsics.width,
        distortion_model="plumb_bob" if distortion is None else distortion.model,
        d=(0.0,) * 5 if distortion is None else distortion.coefficients,
        k=k.ravel(), r=np.eye(3).ravel(), p=p.ravel(),
    )  # fmt: skip
