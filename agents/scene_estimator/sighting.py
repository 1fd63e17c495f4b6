"""What a camera frame or a tag sensor shows: tags and where the tagged objects are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.drivers import TagReadings
from agents.scene_estimator.detection import TagDetector
from agents.scene_estimator.geometry import Intrinsics
from agents.scene_estimator.pose import NoiseModel, estimate_tag_pose
from dsr.blobs import Frame
from dsr.errors import WireError
from dsr.transforms import Pose


class Sighting(NamedTuple):
    """One tagged object in one frame."""

    marker_id: int
    pose: Pose
    """camera_from_object at the object's centre, with covariance and the stamp of the exposure."""


class Outlines(NamedTuple):
    """Where in the image the tags were found."""

    ids: NDArray[np.int32]
    """(n,)"""
    corners: NDArray[np.float32]
    """(n, 4, 2) px"""


class FrameReader:
    """Finds tagged objects in camera frames.

    Args:
        object_size: edge of the object that carries a tag (m), by marker id.
        tag_ratio: side of the tag over that edge.
        noise: error model of the camera.
    """

    def __init__(self, object_size: Callable[[int], float], tag_ratio: float, noise: NoiseModel) -> None:
        self._object_size = object_size
        self._tag_ratio = tag_ratio
        self._noise = noise
        self._detector = TagDetector()

    def read(self, frame: Frame) -> tuple[list[Sighting], Outlines]:
        """Sightings in the frame, and the outlines of all tags found. Raises `WireError` for an unusable frame."""
        color, depth, intrinsics = _images(frame)
        tags = self._detector.detect(color)
        sightings = []
        for tag in tags:
            size = self._object_size(tag.marker_id)
            camera_from_tag = estimate_tag_pose(tag, depth, intrinsics, self._tag_ratio * size, self._noise)
            if camera_from_tag is not None:
                camera_from_object = camera_from_tag @ Pose((0.0, 0.0, -0.5 * size))
                sightings.append(Sighting(tag.marker_id, camera_from_object.with_stamp(frame.stamp)))
        ids = np.array([tag.marker_id for tag in tags], dtype=np.int32)
        corners = np.array([tag.corners for tag in tags], dtype=np.float32).reshape(-1, 4, 2)
        return sightings, Outlines(ids, corners)


def read_sensor(readings: TagReadings, noise: NoiseModel) -> list[Sighting]:
    """Sightings of a tag sensor. Raises `WireError` for poses that are none."""
    try:
        return [
            Sighting(reading.marker_id, Pose(reading.pose[:3], reading.pose[3:], readings.stamp, covariance))
            for reading in readings.readings
            for covariance in [_sensor_covariance(reading.pose, reading, noise)]
        ]
    except ValueError as error:
        raise WireError(f"tag readings at {readings.stamp}: {error}") from error


def _sensor_covariance(pose: tuple[float, ...], reading: Any, noise: NoiseModel) -> NDArray[np.float64]:
    """(6, 6): equal in all directions, plus the systematic error of depth along the viewing ray."""
    camera_from_object = Pose(pose[:3], pose[3:])
    ray = camera_from_object.rotation_matrix.T @ camera_from_object.translation
    ray = ray / max(float(np.linalg.norm(ray)), 1e-9)
    covariance = np.diag([reading.sigma_translation**2] * 3 + [reading.sigma_rotation**2] * 3)
    covariance[:3, :3] += noise.depth_bias_std**2 * np.outer(ray, ray)
    return covariance


def _images(frame: Frame) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None, Intrinsics]:
    color, depth = frame.arrays.get("color"), frame.arrays.get("depth")
    if color is None or color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8 or min(color.shape) < 1:
        raise WireError(f"frame at {frame.stamp}: expected a colour image (h, w, 3) of uint8")
    if depth is not None and (depth.shape != color.shape[:2] or depth.dtype != np.float32):
        raise WireError(f"frame at {frame.stamp}: depth {depth.shape} {depth.dtype}, colour {color.shape}")
    try:
        return color, depth, Intrinsics.from_meta(frame.meta)
    except ValueError as error:
        raise WireError(f"frame at {frame.stamp}: {error}") from error
