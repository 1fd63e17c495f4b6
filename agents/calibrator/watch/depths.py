"""The systematic errors of depth of each camera, by object: learned while its percepts and the beliefs agree."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from dsr.frames.tree import WORLD
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.perception.percepts import PerceptReader
from dsr.vocabulary.relations import THINGS, grasped_things

_SHARE = 0.1  # of the newest percept in the average
_LEARNED = 10  # percepts after which it is known
_MOST_ASIDE, _MOST_DEEP = 0.005, 0.025  # m from the belief, across and along the viewing ray, that may be an error
_NOTED_EVERY = 0.25  # s
_REMAINS = 0.4  # of the scatter of single percepts: that of the learned mean, and that of ten new ones
_LEAST = 0.0003  # m, likewise, of what is not noise


class DepthError(NamedTuple):
    """The systematic error of depth of one object: how much farther the camera sees it than believed, along the viewing
    ray (m).
    """

    mean: float
    """Mean error of depth, m."""
    std: float
    """m, what is left of it, in the mean of a view, once that was taken out"""


class Depths:
    """The systematic errors of depth of all cameras, as they were learned."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._percepts = PerceptReader(memory, timeless=False)
        self._counts: dict[tuple[str, str], int] = {}
        self._errors: dict[tuple[str, str], tuple[float, float]] = {}  # mean (m) and variance (m^2)
        self._earlier: dict[str, deque[tuple[float, dict[str, DepthError]]]] = {}

    def learn(self, camera: str, now: float) -> None:
        """Take in what `camera` sees at time `now` (s) of what is believed to stand still."""
        held = grasped_things(self._memory)
        believed = {
            node.name: edge["pose"]
            for kind in THINGS
            for node in self._memory.nodes(kind)
            if node.get("surprising") is not True and node.name not in held
            if (edge := self._memory.get_edge(WORLD, node.name, "Virtual_RT")) is not None and "pose" in edge
        }
        for percept in self._percepts.new(now, believed, (camera,)):
            camera_from_world = percept.world_from_camera.inverse()
            self._take((camera, percept.name), percept.seen, camera_from_world @ believed[percept.name])

    def of(self, camera: str) -> dict[str, DepthError]:
        """The well-known errors of depth of a camera, by object."""
        return {
            name: DepthError(mean, math.hypot(_LEAST, _REMAINS * math.sqrt(variance)))
            for (other, name), (mean, variance) in self._errors.items()
            if other == camera and self._counts[other, name] >= _LEARNED
        }

    def note(self, camera: str, now: float, span: float) -> None:
        """Keep for `span` s what is known at time `now` (s)."""
        earlier = self._earlier.setdefault(camera, deque())
        if not earlier or now - earlier[-1][0] >= _NOTED_EVERY:
            earlier.append((now, self.of(camera)))
        while len(earlier) > 1 and earlier[1][0] < now - span:
            earlier.popleft()

    def at(self, camera: str, time: float) -> dict[str, DepthError]:
        """The errors of depth as they were known at `time` (s), see `note`."""
        until = [known for stamp, known in self._earlier.get(camera, ()) if stamp <= time]
        return until[-1] if until else {}

    def forget(self, camera: str) -> None:
        """The camera is believed elsewhere now, which changes all of them."""
        self._earlier.pop(camera, None)
        for known in (self._counts, self._errors):
            for key in [key for key in known if key[0] == camera]:
                del known[key]

    def _take(self, key: tuple[str, str], percept: Pose, expected: Pose) -> None:
        offset: Array = np.subtract(percept.t, expected.t)
        along = float(offset @ ray_to(percept))
        aside = math.sqrt(max(float(offset @ offset) - along**2, 0.0))
        if aside > _MOST_ASIDE or abs(along) > _MOST_DEEP:
            return
        count = self._counts[key] = self._counts.get(key, 0) + 1
        mean, variance = self._errors.get(key, (along, 0.0))
        share, change = max(_SHARE, 1.0 / count), along - mean
        self._errors[key] = mean + share * change, (1.0 - share) * (variance + share * change**2)


def ray_to(percept: Pose) -> Array:
    """(3,) unit vector from the camera to an object, in the camera's frame."""
    place: Array = np.array(percept.t)
    return place / max(float(np.linalg.norm(place)), 1e-9)


def without_error(percept: Pose, error: float) -> Pose:
    """A percept (camera_from_object) without a known systematic error of depth (m)."""
    x, y, z = (np.array(percept.t) - error * ray_to(percept)).tolist()
    return Pose((x, y, z), percept.q, percept.stamp, percept.cov)
