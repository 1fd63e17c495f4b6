"""The systematic errors of depth of one camera, by object: learned while its percepts and the beliefs agree."""

from __future__ import annotations

import math

import numpy as np

from dsr.errors import TransformError
from dsr.memory import Memory
from dsr.relations import THINGS
from dsr.transforms import Array, Pose

WORLD = "world"
_SHARE = 0.1  # of the newest percept in the average
_LEARNED = 10  # percepts after which it is known
_MOST_ASIDE, _MOST_DEEP = 0.005, 0.025  # m from the belief, across and along the viewing ray, that may be an error


class Depths:
    """How much farther than believed each camera sees each object, on average, in m along the viewing ray."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._stamps: dict[tuple[str, str], float] = {}
        self._counts: dict[tuple[str, str], int] = {}
        self._errors: dict[tuple[str, str], float] = {}

    def learn(self, camera: str) -> None:
        """Take in what `camera` sees now of what is believed to stand still."""
        held = {edge.dst for edge in self._memory.edges("grasping")}
        for edge in self._memory.edges("RT", src=camera):
            key, percept = (camera, edge.dst), edge.get("pose")
            node, belief = self._memory.get_node(edge.dst), self._memory.get_edge(WORLD, edge.dst, "Virtual_RT")
            if percept is None or belief is None or node is None or node.type not in THINGS:
                continue
            if edge.dst in held or node.get("surprising") is True or self._stamps.get(key) == percept.stamp:
                continue
            self._stamps[key] = percept.stamp
            try:
                world_from_camera = self._memory.transform(WORLD, camera, at=percept.stamp)
            except TransformError:
                continue
            self._take(key, percept, world_from_camera.inverse() @ belief["pose"])

    def of(self, camera: str) -> dict[str, float]:
        """By object, m; only what is known well."""
        return {
            name: error
            for (other, name), error in self._errors.items()
            if other == camera and self._counts[other, name] >= _LEARNED
        }

    def forget(self, camera: str) -> None:
        """The camera is believed elsewhere now, which changes all of them."""
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
        before = self._errors.get(key, 0.0)
        self._errors[key] = before + max(_SHARE, 1.0 / count) * (along - before)


def ray_to(percept: Pose) -> Array:
    """(3,) unit vector from the camera to an object, in the camera's frame."""
    place: Array = np.array(percept.t)
    return place / max(float(np.linalg.norm(place)), 1e-9)


def without_error(percept: Pose, error: float) -> Pose:
    """A percept (camera_from_object) without a known systematic error of depth (m)."""
    x, y, z = (np.array(percept.t) - error * ray_to(percept)).tolist()
    return Pose((x, y, z), percept.q, percept.stamp, percept.cov)
