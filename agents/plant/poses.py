"""A sensor that tells poses of tags and colours instead of images: the truth with the errors measured on images."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.colors import Color
from agents.drivers import ColorReading, TagReading, TagReadings
from agents.plant.camera import SimulatedCamera
from agents.plant.hands import Hands
from agents.plant.messages import seven
from agents.plant.world import World
from agents.scenario.format.scenario import ObjectSpec
from dsr.math3d.quaternions import Vector3
from dsr.math3d.surfaces import seen_alone
from dsr.math3d.transforms import Pose
from dsr.vocabulary.tags import TAG_RATIO

DISTANCES = (0.3, 0.6, 1.0)
"""m from the camera, at which the errors below were measured (32 mm tag, 640 x 480, plane fitted to depth)"""
SIGMA_TRANSLATION = (0.0005, 0.00075, 0.0016)
"""m, of each coordinate: the measured median of the distance, 0.75, 1.1 and 2.5 mm, over 1.54"""
SIGMA_ROTATION = tuple(math.radians(degrees) for degrees in (0.033, 0.22, 1.1))
"""rad, about each axis: the measured median of the angle, 0.05, 0.34 and 1.7 degrees, over 1.54"""
COLOR_DISTANCES = (0.6, 1.0, 1.3)
"""m from the camera, at which the errors of colours were measured"""
SIGMA_COLOR = (0.0012, 0.0015, 0.0025)
"""m, of each coordinate of the centre of an object that is recognised by its colour and seen completely"""
SIGMA_TURN = 0.02
"""rad, about each axis: medians of the tilt's error are 0.002 to 0.045 rad by object and distance, most of them near
0.02 (`python -m benchmarks.perception --tilted --distances 0.9 1.4`); of yaws, see `--colors`"""
STEEPEST = math.radians(75)
"""rad between the tag's normal and the viewing ray, beyond which a tag is not found"""
SMALLEST = 12.0
"""px, the side of the smallest tag that is found, and the width of the smallest spot of a colour"""

_LOOK = np.array([[0, 0], [-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.95  # points of a tag, in half sides
_ENOUGH = 0.35  # share of an object's image by which its colour is recognised
_ENOUGH_FOR_TILT = 0.5  # likewise, by which it is seen how it leans
_MOST_RAYS: int = pybullet.MAX_RAY_INTERSECTION_BATCH_SIZE
_REACHED = 0.999  # share of a ray without obstacle that counts as reaching its end; what is behind a thin wall is not


def read_tags(camera: SimulatedCamera, world: World, hands: Hands, stamp: float) -> TagReadings:
    """Simulate the readings of `camera` by tags and colours, with its errors; drawn also for objects that it does not
    see.
    """
    errors = camera.sensor.errors()
    seen = TagReadings(stamp, [], camera.intrinsics, [])
    camera.in_view = []
    camera_from_world = camera.pose.inverse()
    poses = {} if camera.covers else camera.seen_poses(world)
    poses = {name: camera_from_world @ pose for name, pose in poses.items()}
    shares = _shares_seen(camera, world, hands, poses)
    for name, spec in world.specs.items():
        noise = camera.sensor.normal(6)
        if (share := shares.get(name, 0.0)) < _ENOUGH:
            continue
        pose = poses[name]
        camera.in_view.append(name)
        if spec.marker_id is not None:
            seen.readings.append(_measured(spec.marker_id, pose, errors[name], noise))
        elif spec.color is not None:
            shows_tilt = len(spec.shape) > 1 and share >= _ENOUGH_FOR_TILT
            axes = _measured_axes(pose, noise) if shows_tilt else None
            seen.colors.append(_measured_color(spec.color, pose, errors[name], noise, share, axes))
    return seen


def recognisable(camera: SimulatedCamera, world: World, hands: Hands) -> list[str]:
    """Names of the objects that `camera` could recognise now, those without tag and known colour by their shape."""
    if camera.covers:
        return []
    camera_from_world = camera.pose.inverse()
    poses = {name: camera_from_world @ pose for name, pose in world.poses().items()}
    shares = _shares_seen(camera, world, hands, poses)
    for name, pose in poses.items():
        if world.specs[name].by_depth:
            shares[name] = _share_of_color(camera, world, hands, world.specs[name], pose)
    return [name for name in world.specs if shares.get(name, 0.0) >= _ENOUGH]


def _shares_seen(camera: SimulatedCamera, world: World, hands: Hands, poses: Mapping[str, Pose]) -> dict[str, float]:
    """By object at a pose camera_from_object: 1 or 0 for a tag; how much there is to see of the image of what is
    recognised by its colour; else 0.
    """
    tagged = {name: pose for name, pose in poses.items() if world.specs[name].marker_id is not None}
    shares = dict(zip(tagged, _see(camera, world, hands, tagged).astype(float).tolist(), strict=True))
    for name in poses.keys() - tagged.keys():
        spec = world.specs[name]
        shares[name] = _share_of_color(camera, world, hands, spec, poses[name]) if spec.by_color else 0.0
    return shares


def _measured(marker_id: int, camera_from_object: Pose, error: float, noise: NDArray[np.float64]) -> TagReading:
    """The pose moved towards the camera by `error` m, then disturbed by `noise` (6,) in standard deviations."""
    distance = math.hypot(*camera_from_object.t)
    sigma_translation = float(np.interp(distance, DISTANCES, SIGMA_TRANSLATION))
    sigma_rotation = float(np.interp(distance, DISTANCES, SIGMA_ROTATION))
    nearer = camera_from_object.translation * (1 - error / distance)
    exact = Pose(nearer, camera_from_object.q)
    measured = exact @ Pose.from_rotvec(noise[:3] * sigma_translation, noise[3:] * sigma_rotation)
    return TagReading(marker_id, seven(measured), sigma_translation, sigma_rotation)


def _measured_color(
    color: Color,
    camera_from_object: Pose,
    error: float,
    noise: NDArray[np.float64],
    share: float,
    axes: tuple[Vector3, Vector3] | None,
) -> ColorReading:
    """The centre moved towards the camera by `error` m, then disturbed; the less is seen, the more."""
    distance = math.hypot(*camera_from_object.t)
    sigma = float(np.interp(distance, COLOR_DISTANCES, SIGMA_COLOR)) / share
    x, y, z = (camera_from_object.translation * (1 - error / distance) + noise[:3] * sigma).tolist()
    return ColorReading(color, (x, y, z), sigma, *(axes or ()))


def _measured_axes(camera_from_object: Pose, noise: NDArray[np.float64]) -> tuple[Vector3, Vector3]:
    """The own z and x axes of an object, of which only a hollow or composite shape tells, disturbed."""
    measured = camera_from_object @ Pose.from_rotvec((0.0, 0.0, 0.0), noise[3:] * SIGMA_TURN)
    x_axis, _, z_axis = measured.rotation_matrix.T.tolist()
    return tuple(z_axis), tuple(x_axis)


def _share_of_color(
    camera: SimulatedCamera, world: World, hands: Hands, spec: ObjectSpec, camera_from_object: Pose
) -> float:
    """Share of the object's image that is there: in the image, and with nothing in front of it."""
    points, weights = seen_alone(spec.shape, spec.size, camera_from_object.inverse().translation)
    points = camera_from_object.apply(points)
    intrinsics = camera.intrinsics
    if len(points) == 0 or points[:, 2].min() <= 0:
        return 0.0
    pixels = intrinsics.project(points)
    inside = ((pixels >= 0) & (pixels <= (intrinsics.width - 1, intrinsics.height - 1))).all(axis=1)
    if not inside.any() or np.ptp(pixels[inside], axis=0).min() < SMALLEST:
        return 0.0
    bodies = np.full(int(inside.sum()), world.body(spec.name))
    free = _free(camera.pose, world, hands, bodies, points[inside])
    return float(weights[inside][free].sum())


def _see(camera: SimulatedCamera, world: World, hands: Hands, poses: Mapping[str, Pose]) -> NDArray[np.bool_]:
    """(n,) which tags face the camera, are large enough, and wholly in the image and in view.

    `poses` are camera_from_object, by the names of objects with tags.
    """
    if not poses:
        return np.zeros(0, bool)
    sizes = np.array([world.specs[name].size for name in poses])
    halves = TAG_RATIO * sizes[:, :2].min(axis=1) / 2
    heights = np.broadcast_to(sizes[:, 2, None, None] / 2, (len(poses), len(_LOOK), 1))
    tags = np.concatenate([_LOOK * halves[:, None, None], heights], axis=2)
    matrices = np.array([pose.matrix for pose in poses.values()])
    points = tags @ np.swapaxes(matrices[:, :3, :3], 1, 2) + matrices[:, None, :3, 3]
    facing = -(matrices[:, :3, 2] * points[:, 0]).sum(axis=1) / np.linalg.norm(points[:, 0], axis=1)
    sees: NDArray[np.bool_] = (facing >= math.cos(STEEPEST)) & (points[..., 2].min(axis=1) > 0)
    intrinsics = camera.intrinsics
    sees[sees] = 2 * halves[sees] * intrinsics.fx / points[sees, 0, 2] >= SMALLEST
    pixels = intrinsics.project(points[sees])
    last = (intrinsics.width - 1, intrinsics.height - 1)
    sees[sees] = ((pixels >= 0) & (pixels <= last)).all(axis=(1, 2))
    bodies = np.array([world.body(name) for name in poses])[sees]
    free = _free(camera.pose, world, hands, np.repeat(bodies, len(_LOOK)), points[sees].reshape(-1, 3))
    sees[sees] = free.reshape(-1, len(_LOOK)).all(axis=1)
    return sees


def _free(
    world_from_camera: Pose, world: World, hands: Hands, bodies: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,) between which points (n, 3) m in the optical frame and the camera nothing stands but their `bodies` (n,)."""
    targets = world_from_camera.apply(points)
    eyes = [world_from_camera.t]
    found: list[tuple[int, float]] = []
    for begin in range(0, len(targets), _MOST_RAYS):
        some = targets[begin : begin + _MOST_RAYS].tolist()
        found += [(hit[0], hit[2]) for hit in world.bullet.rayTestBatch(eyes * len(some), some)]
    hits, ways = np.array(found).reshape(-1, 2).T
    free: NDArray[np.bool_] = (hits == -1) | (hits == bodies) | (ways > _REACHED)
    return free & ~hands.hide(world_from_camera.translation, targets) if hands.present else free
