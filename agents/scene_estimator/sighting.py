"""Sightings of a camera frame or a tag sensor: tags and the poses of tagged objects."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.drivers import TagCorners, TagReading, TagReadings
from agents.frame_images import images
from agents.scene_estimator.detection import Tag
from agents.scene_estimator.following import TagFollower
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.search import TagSearch
from dsr.errors import WireError
from dsr.images.blobs import Frame
from dsr.math3d.batches import Array, adjoints, inverses
from dsr.math3d.quaternions import rotate
from dsr.math3d.transforms import Pose
from dsr.vocabulary import tags
from dsr.vocabulary.intrinsics import Intrinsics

Size = tuple[float, float, float]


class Sighting(NamedTuple):
    """One tagged object in one frame."""

    marker_id: int
    pose: Pose
    """camera_from_object at the object's centre, with covariance and the stamp of the exposure."""


class Outlines(NamedTuple):
    """The outlines of the found tags in the image."""

    ids: NDArray[np.int32]
    """(n,) numbers of the tags"""
    corners: NDArray[np.float32]
    """(n, 4, 2) px, corners of the tags in the image"""


class FrameSource:
    """Finds tagged objects in the frames of one camera, and follows them.

    Args:
        object_size: extent along x, y, z (m) of the object that carries a tag on its +z face, by marker id.
        tag_ratio: side of the tag over the shorter side of that face.
        noise: error model of the camera.
    """

    def __init__(self, object_size: Callable[[int], Size], tag_ratio: float, noise: NoiseModel) -> None:
        self._object_size = object_size
        self._tag_ratio = tag_ratio
        self._noise = noise
        self._search = TagSearch()
        self._follower = TagFollower(noise)

    def read(self, frame: Frame) -> tuple[list[Sighting], Outlines]:
        """Sightings in the frame, and the outlines of all tags found. Raises `WireError` for an unusable frame."""
        color, depth, intrinsics = images(frame)
        tags = [self._seen_through_lens(tag) for tag in self._search.find(color, frame.stamp)]
        sightings = self._sightings(tags, depth, intrinsics, frame.stamp)
        ids = np.array([tag.marker_id for tag in tags], dtype=np.int32)
        corners = np.array([tag.corners for tag in tags], dtype=np.float32).reshape(-1, 4, 2)
        return sightings, Outlines(ids, corners)

    def _seen_through_lens(self, tag: Tag) -> Tag:
        """With the error of a real lens beside that of the detector."""
        return replace(tag, corner_std=math.hypot(tag.corner_std, self._noise.corner_std))

    def read_corners(self, readings: TagReadings) -> list[Sighting]:
        """Sightings of tags that a device found without their poses. Raises `WireError` for corners that are none."""
        found = [_tag(corners) for corners in readings.corners]
        if found and readings.intrinsics is None:
            raise WireError(f"tag readings at {readings.stamp}: corners without intrinsics")
        return [] if readings.intrinsics is None else self._sightings(found, None, readings.intrinsics, readings.stamp)

    def _sightings(
        self, tags: list[Tag], depth: NDArray[np.float32] | None, intrinsics: Intrinsics, stamp: float
    ) -> list[Sighting]:
        objects = [self._object_size(tag.marker_id) for tag in tags]
        sides = [self._tag_ratio * min(width, length) for width, length, _ in objects]
        poses = self._follower.poses(tags, depth, intrinsics, sides, stamp)
        found = [
            (tag.marker_id, height, pose)
            for tag, (_, _, height), pose in zip(tags, objects, poses, strict=True)
            if pose is not None
        ]
        if not found:
            return []
        ids, heights, camera_from_tags = zip(*found, strict=True)
        return list(map(Sighting, ids, _centres(camera_from_tags, np.array(heights), stamp)))


def _centres(camera_from_tags: Sequence[Pose], heights: Array, stamp: float) -> list[Pose]:
    """camera_from_object at the centres of objects of those heights (m), which carry tags on their upper sides."""
    tag_from_object = np.tile(np.eye(4), (len(heights), 1, 1))
    tag_from_object[:, 2, 3] = -0.5 * heights
    back = adjoints(inverses(tag_from_object))
    covariances = back @ np.array([pose.covariance for pose in camera_from_tags]) @ back.mT
    rows = (0.5 * (covariances + covariances.mT)).reshape(-1, 36).tolist()
    normals = (rotate(pose.q, (0.0, 0.0, 1.0)) for pose in camera_from_tags)
    places = np.array([pose.t for pose in camera_from_tags]) - 0.5 * heights[:, None] * np.array(list(normals))
    return [
        Pose.unchecked((x, y, z), pose.q, stamp, tuple(row))
        for (x, y, z), pose, row in zip(places.tolist(), camera_from_tags, rows, strict=True)
    ]


def _tag(found: TagCorners) -> Tag:
    """The tag of a device that finds corners. Raises `WireError`."""
    corners = np.array(found.corners, dtype=np.float64)
    if not (0 <= found.marker_id < tags.COUNT and np.isfinite(corners).all() and 0.0 < found.sigma < np.inf):
        raise WireError(f"corners of tag {found.marker_id}: expected finite px, and an id below {tags.COUNT}")
    return Tag(found.marker_id, corners, found.sigma)


def read_sensor(readings: TagReadings, noise: NoiseModel) -> list[Sighting]:
    """Sightings of a tag sensor. Raises `WireError` for poses and ids that are none."""
    try:
        return [_sensed(reading, readings.stamp, noise) for reading in readings.readings]
    except ValueError as error:
        raise WireError(f"tag readings at {readings.stamp}: {error}") from error


def _sensed(reading: TagReading, stamp: float, noise: NoiseModel) -> Sighting:
    """Its covariance is equal in all directions, plus the systematic error of depth along the viewing ray."""
    if not 0 <= reading.marker_id < tags.COUNT:
        raise ValueError(f"marker id {reading.marker_id}: expected 0 to {tags.COUNT - 1}")
    camera_from_object = Pose(reading.pose[:3], reading.pose[3:], stamp)
    ray = camera_from_object.rotation_matrix.T @ camera_from_object.translation
    ray = ray / max(float(np.linalg.norm(ray)), 1e-9)
    covariance = np.diag([reading.sigma_translation**2] * 3 + [reading.sigma_rotation**2] * 3)
    covariance[:3, :3] += noise.depth_bias_std**2 * np.outer(ray, ray)
    return Sighting(reading.marker_id, camera_from_object.with_covariance(covariance))
