"""Objects that are recognised by their colour: the known ones, and the pose that a sighting of one tells."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from agents.colors import APART, TOLERANCE, spectral_angle
from agents.drivers import ColorReading, TagReadings
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.turning import ROUND, nearest_turn, order
from dsr.errors import SchemaError, WireError
from dsr.graph.elements import Node
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape, from_numbers
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.vocabulary.bodies import bodies_by_name
from dsr.vocabulary.perceived import BY_DEPTH
from dsr.vocabulary.relations import THINGS

ANY_ROTATION = math.pi
"""rad, standard deviation about each axis of an orientation that nobody measured"""
LEANING = 0.15
"""rad, likewise, of a tilt that was seen"""
UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
OVERTURNED: Quaternion = (1.0, 0.0, 0.0, 0.0)
TURNED = 0.03
"""rad, likewise, of the yaw that a sensor without images tells of what stands upright"""
LEANS = 0.25
"""rad of tilt from which an object counts as leaning"""
_FARTHEST = 100.0  # m
_ROUNDING = 1e-3


class ColoredObject(NamedTuple):
    """The known properties of an object that has a colour."""

    name: str
    color: Vector3
    """Red, green, blue, 0 to 1."""
    size: Vector3
    """Edge lengths of its bounding box, m."""
    shape: Shape
    """Shape of the object; none for a solid box."""
    tagged: bool = False
    """Whether its upper side (+z) carries a tag, and so not its colour."""


class ColorSighting(NamedTuple):
    """One object recognised by its colour, in one frame."""

    name: str
    position: Array
    """(3,) m, its centre in the camera frame."""
    covariance: Array
    """(3, 3) m^2, in the camera frame."""
    stamp: float
    """s, of the exposure"""
    lean: Quaternion | None = None
    """In the world, from standing upright to how it is turned; None if that could not be seen."""
    yaw: float = 0.0
    """rad, about its own z axis, before that"""
    yaw_sigma: float = math.inf
    """rad, standard deviation of the yaw; infinite if that could not be seen"""

    def pose(self, world_from_camera: Pose) -> Pose:
        """camera_from_object with covariance: as it is seen to be turned, and upright where that cannot be seen."""
        camera_from_world = world_from_camera.inverse()
        lean = UPRIGHT if self.lean is None else self.lean
        tilt = ANY_ROTATION if self.lean is None else LEANING
        yaw = min(self.yaw_sigma, ANY_ROTATION if lean == UPRIGHT else LEANING)
        about_z = quaternions.from_rotvec((0.0, 0.0, self.yaw))
        rotation = quaternions.product(camera_from_world.q, quaternions.product(lean, about_z))
        turn = Pose((0.0, 0.0, 0.0), rotation).rotation_matrix
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = turn.T @ self.covariance @ turn
        covariance[3:, 3:] = np.diag((tilt**2, tilt**2, yaw**2))
        return Pose(self.position, rotation, self.stamp, covariance)


class ColoredObjects:
    """The working memory's objects that have a colour, of those that are simulated.

    Args:
        memory: the working memory.
        max_age: s after which a tag that was not read again does not tell any more where its object is.
    """

    def __init__(self, memory: Memory, max_age: float) -> None:
        self._memory = memory
        self._max_age = max_age
        self._watches = [memory.watch(attribute=name) for name in ("color", "marker_id", "size", "shape")]
        self.known: list[ColoredObject] = []
        """Those without a tag"""
        self._tagged: list[ColoredObject] = []
        """Those with a tag whose colour no other object has"""
        self._read: dict[str, float] = {}
        """s, when the tag of one of these was read last"""
        self.turned: dict[str, Quaternion] = {}
        """world_from_object of what was last seen of rotations"""

    def update(self) -> None:
        """Take note of what was written to nodes."""
        news = [watch.poll() for watch in self._watches]
        if any(news):
            bodies = bodies_by_name(self._memory, THINGS)
            found = [colored for colored in map(_colored, bodies) if colored is not None]
            self.known = [colored for colored in found if not colored.tagged]
            self._tagged = [colored for colored in found if colored.tagged and _is_unlike_others(colored, bodies)]
            self._read = {one.name: self._read[one.name] for one in self._tagged if one.name in self._read}

    def note_read(self, names: Iterable[str], stamp: float) -> None:
        """Take note of the objects whose tags some camera has read at `stamp` (s): a tag tells more than a colour."""
        mine = {colored.name for colored in self._tagged}
        self._read.update({name: max(stamp, self._read.get(name, stamp)) for name in names if name in mine})

    def looked_for(self, stamp: float) -> list[ColoredObject]:
        """Those to find by colour in an image of `stamp` (s): without a tag, or with one that no camera reads."""
        unread = [one for one in self._tagged if stamp - self._read.get(one.name, -math.inf) > self._max_age]
        return self.known + unread

    def find(self, color: Vector3) -> ColoredObject | None:
        """Find the object of that colour which has no tag; None if there is none."""
        angles = {colored: spectral_angle(color, colored.color) for colored in self.known}
        best = min(angles, key=lambda colored: angles[colored], default=None)
        return best if best is not None and angles[best] < TOLERANCE else None

    def close(self) -> None:
        """Stop watching."""
        for watch in self._watches:
            watch.close()


def read_colors(
    readings: TagReadings, objects: ColoredObjects, noise: NoiseModel, world_from_camera: Pose | None
) -> list[ColorSighting]:
    """Sightings of a sensor that tells colours. Raises `WireError` for places where nothing can be."""
    found = [_sensed(reading, readings.stamp, objects, noise, world_from_camera) for reading in readings.colors]
    return [sighting for sighting in found if sighting is not None]


def lean_of(up: Vector3) -> Quaternion:
    """The shortest rotation in the world from the vertical to the unit vector `up`; none for less than `LEANS`.

    What is upside down by less than that is turned about the x axis: noise says about which one.
    """
    x, y, z = up
    angle, sine = math.acos(min(max(z, -1.0), 1.0)), math.hypot(x, y)
    if angle < LEANS:
        return UPRIGHT
    if angle > math.pi - LEANS:
        return OVERTURNED
    return quaternions.from_rotvec((-y / sine * angle, x / sine * angle, 0.0))


def _sensed(
    reading: ColorReading, stamp: float, objects: ColoredObjects, noise: NoiseModel, world_from_camera: Pose | None
) -> ColorSighting | None:
    position = np.array(reading.position, dtype=np.float64)
    numbers = (*reading.position, *reading.color, reading.sigma, *(reading.up or ()), *(reading.ahead or ()))
    if not all(map(math.isfinite, numbers)) or not _near(position) or not 0.0 <= reading.sigma < _FARTHEST:
        raise WireError(f"colour reading at {stamp}: {reading}: expected a place within {_FARTHEST} m")
    if (colored := objects.find(reading.color)) is None:
        return None
    ray = position / np.linalg.norm(position)
    covariance = reading.sigma**2 * np.eye(3) + noise.depth_bias_std**2 * np.outer(ray, ray)
    if any(abs(math.hypot(*axis) - 1.0) > _ROUNDING for axis in (reading.up, reading.ahead) if axis is not None):
        raise WireError(f"colour reading at {stamp}: up {reading.up}, ahead {reading.ahead}: expected unit vectors")
    lean, yaw_sigma, before = None, math.inf, objects.turned.get(colored.name, UPRIGHT)
    if reading.up is not None and world_from_camera is not None:
        lean = lean_of(quaternions.rotate(world_from_camera.q, reading.up))
        if reading.ahead is not None and (count := order(colored.shape, colored.size)) != ROUND:
            seen = _turn(lean, quaternions.rotate(world_from_camera.q, reading.ahead))
            before = objects.turned[colored.name] = nearest_turn(seen, before, count)
            yaw_sigma = TURNED
    _, _, z, w = quaternions.about_z(before)
    return ColorSighting(colored.name, position, covariance, stamp, lean, 2.0 * math.atan2(z, w), yaw_sigma)


def _turn(lean: Quaternion, ahead: Vector3) -> Quaternion:
    """world_from_object of what leans like that, if its own x axis points `ahead` in the world."""
    x, y, _ = quaternions.rotate(quaternions.conjugate(lean), ahead)
    return quaternions.product(lean, quaternions.from_rotvec((0.0, 0.0, math.atan2(y, x))))


def _near(position: Array) -> bool:
    return 0.0 < float(np.abs(position).max()) < _FARTHEST


def _colored(node: Node) -> ColoredObject | None:
    """None for an object without colour or size, with a shape that is none, or that is found by depth."""
    color, size, numbers = node.get("color"), node.get("size"), node.get("shape")
    if color is None or size is None or min(size) <= 0.0:
        return None
    if node.get("source") == BY_DEPTH:
        return None
    try:
        shape = () if numbers is None else from_numbers(numbers)
    except SchemaError:
        return None
    tagged = node.get("marker_id") is not None
    return ColoredObject(node.name, (color[0], color[1], color[2]), (size[0], size[1], size[2]), shape, tagged)


def _is_unlike_others(colored: ColoredObject, bodies: Iterable[Node]) -> bool:
    """Whether the colour of one object tells it from all others: what two have in common tells neither."""
    others = (node.get("color") for node in bodies if node.name != colored.name)
    return all(spectral_angle(colored.color, other) >= APART for other in others if other is not None)
