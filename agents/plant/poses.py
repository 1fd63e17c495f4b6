"""A sensor that tells poses of tags instead of images: the truth with the errors measured on images."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.drivers import TagReading, TagReadings
from agents.plant.camera import Camera
from agents.plant.hands import Hands
from agents.plant.messages import seven
from agents.plant.tags import TAG_RATIO
from agents.plant.world import World
from agents.scenario.format import ObjectSpec
from dsr.transforms import Pose

DISTANCES = (0.3, 0.6, 1.0)
"""m from the camera, at which the errors below were measured (32 mm tag, 640 x 480, plane fitted to depth)"""
SIGMA_TRANSLATION = (0.0005, 0.00075, 0.0016)
"""m, of each coordinate: the measured median of the distance, 0.75, 1.1 and 2.5 mm, over 1.54"""
SIGMA_ROTATION = tuple(math.radians(degrees) for degrees in (0.033, 0.22, 1.1))
"""rad, about each axis: the measured median of the angle, 0.05, 0.34 and 1.7 degrees, over 1.54"""
STEEPEST = math.radians(75)
"""rad between the tag's normal and the viewing ray, beyond which a tag is not found"""
SMALLEST = 12.0
"""px, the side of the smallest tag that is found"""

_LOOK = np.array([[0, 0], [-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.95  # points of a tag, in half sides
_REACHED = 0.995  # share of a ray without obstacle that counts as reaching the tag


def read_tags(camera: Camera, world: World, hands: Hands, stamp: float) -> TagReadings:
    """The tags that `camera` sees now, with its errors; drawn also for those it does not see."""
    errors = camera.sensor.errors()
    readings = []
    camera.in_view = []
    poses = {} if camera.covers else camera.seen_poses(world)
    camera_from_world = camera.pose.inverse()
    for name, spec in world.specs.items():
        noise = camera.sensor.normal(6)
        if spec.marker_id is None or name not in poses:
            continue
        pose = camera_from_world @ poses[name]
        if _sees(camera, world, hands, spec, pose):
            readings.append(_measured(spec.marker_id, pose, errors[name], noise))
            camera.in_view.append(name)
    return TagReadings(stamp, readings, camera.lens)


def tags_in_view(camera: Camera, world: World, hands: Hands) -> list[str]:
    """Names of the objects whose tag `camera` could see now."""
    camera_from_world = camera.pose.inverse()
    specs = [spec for name, spec in world.specs.items() if name in world and spec.marker_id is not None]
    if camera.covers:
        return []
    poses = {spec.name: camera_from_world @ world.pose(spec.name) for spec in specs}
    return [spec.name for spec in specs if _sees(camera, world, hands, spec, poses[spec.name])]


def _measured(marker_id: int, camera_from_object: Pose, error: float, noise: NDArray[np.float64]) -> TagReading:
    """The pose moved towards the camera by `error` m, then disturbed by `noise` (6,) in standard deviations."""
    distance = math.hypot(*camera_from_object.t)
    sigma_translation = float(np.interp(distance, DISTANCES, SIGMA_TRANSLATION))
    sigma_rotation = float(np.interp(distance, DISTANCES, SIGMA_ROTATION))
    nearer = camera_from_object.translation * (1 - error / distance)
    exact = Pose(nearer, camera_from_object.q)
    measured = exact @ Pose.from_rotvec(noise[:3] * sigma_translation, noise[3:] * sigma_rotation)
    return TagReading(marker_id, seven(measured), sigma_translation, sigma_rotation)


def _sees(camera: Camera, world: World, hands: Hands, spec: ObjectSpec, camera_from_object: Pose) -> bool:
    """Whether the tag faces the camera, is large enough, and wholly in the image and in view."""
    half = TAG_RATIO * min(spec.size[:2]) / 2
    tag = np.column_stack([_LOOK * half, np.full(len(_LOOK), spec.size[2] / 2)])
    points = camera_from_object.apply(tag)
    normal = camera_from_object.rotation_matrix[:, 2]
    facing = -float(normal @ points[0]) / float(np.linalg.norm(points[0]))
    if facing < math.cos(STEEPEST) or points[:, 2].min() <= 0:
        return False
    lens = camera.lens
    if 2 * half * lens.fx / points[0, 2] < SMALLEST:
        return False
    pixels = lens.project(points)
    if pixels.min() < 0 or (pixels > (lens.width - 1, lens.height - 1)).any():
        return False
    return _in_view(camera.pose, world, hands, spec.name, points)


def _in_view(world_from_camera: Pose, world: World, hands: Hands, name: str, points: NDArray[np.float64]) -> bool:
    """Whether nothing stands between the camera and points (n, 3) m of the object, in the optical frame."""
    targets = world_from_camera.apply(points)
    eyes = np.broadcast_to(world_from_camera.t, targets.shape)
    hits = world.bullet.rayTestBatch(eyes.tolist(), targets.tolist())
    if hands.present and hands.hide(world_from_camera.translation, targets).any():
        return False
    return all(hit[0] in (-1, world.body(name)) or hit[2] > _REACHED for hit in hits)
