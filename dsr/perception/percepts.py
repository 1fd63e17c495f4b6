"""New percepts: the poses of things that cameras have written since the last look, and where the camera was then."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator
from copy import copy
from typing import NamedTuple

from dsr.errors import DsrError, ExtrapolationError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Edge
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.reach import FARTHEST
from dsr.perception.scales import RECENT_PERCEPTS
from dsr.vocabulary.perceived import MOST_AHEAD


class Percept(NamedTuple):
    """A percept: the pose of one thing as one camera saw it at one moment."""

    camera: str
    """Name of the frame that it was seen from."""
    name: str
    """Name of the thing."""
    stamp: float
    """s; of a percept that holds at all times, the time of the look that found it"""
    seen: Pose
    """camera_from_thing as it stands in the graph, with its covariance if it has one"""
    world_from_camera: Pose
    """Pose of the camera in the world at the percept's stamp."""

    @property
    def pose(self) -> Pose:
        """world_from_thing, worked out anew at each call."""
        return self.world_from_camera @ self.seen

    @property
    def eye(self) -> Vector3:
        """M, place of the camera in the world."""
        return self.world_from_camera.t


class PerceptReader:
    """Gives each percept once: the pose of an RT edge to a thing, as soon as the place of its camera then is known.

    A pose is new if its stamp is later than that of the last one given of the same edge. Who looks seldom gets those in
    between, too, but for the oldest of very many, and for what was not asked for at the last look. A pose of stamp 0
    holds at all times: such is a percept of each look. What cannot be used is counted. It is tried again at the next
    look, unless it is too old or too far away.

    Args:
        memory: the graph.
        oldest: s; what was seen longer ago than that, when it is found, is never given.
        timeless: give poses of stamp 0.
    """

    def __init__(self, memory: Memory, *, oldest: float = math.inf, timeless: bool = True) -> None:
        self._memory = memory
        self._timeless = timeless
        self._oldest = oldest
        self._given: dict[tuple[str, str], float] = {}  # (camera, thing) -> stamp of the newest percept
        self._asked: set[tuple[str, str]] = set()  # (camera, thing) at the last look
        self.skipped: Counter[str] = Counter()
        """How often a percept could not be used, by reason."""
        self.problems: dict[str, str] = {}
        """Why, in the last look, by the name of the thing."""

    def new(self, now: float, names: Collection[str], cameras: Collection[str] | None = None) -> list[Percept]:
        """Return the percepts that were not returned before, sorted by the name of the thing, and then by their stamps.

        Args:
            now: s, the time of the look.
            names: the things that are asked for.
            cameras: the frames to be seen from; None for whatever an RT edge comes from.
        """
        self.problems = {}
        places = _CameraPlaces(self._memory)
        edge_of = self._memory.get_edge
        self._given = {key: stamp for key, stamp in self._given.items() if edge_of(*key, "RT") is not None}
        found, asked = [], set[tuple[str, str]]()
        for name in sorted(names):
            of_thing: list[Percept] = []
            for edge in self._memory.edges("RT", dst=name):
                if cameras is None or edge.src in cameras:
                    asked.add((edge.src, edge.dst))
                    of_thing += self._new_of(edge, now, places)
            found += sorted(of_thing, key=lambda percept: percept.stamp)
        self._asked = asked
        return found

    def _new_of(self, edge: Edge, now: float, places: _CameraPlaces) -> Iterator[Percept]:
        """The percepts of an edge that were not given before, the oldest first."""
        for pose in self._poses(edge, now):
            stamp = pose.stamp or (now if self._timeless else -math.inf)
            if stamp > self._given.get((edge.src, edge.dst), -math.inf):
                percept = self._percept(edge, pose, stamp, now, places)
                if percept is not None:
                    self._given[edge.src, edge.dst] = stamp
                    yield percept

    def _poses(self, edge: Edge, now: float) -> list[Pose]:
        """The newest pose, and before it those since the last one that was given, if they are not too old."""
        newest, given = edge.get("pose"), self._given.get((edge.src, edge.dst))
        if newest is None:
            return []
        if given is None or newest.stamp <= given or (edge.src, edge.dst) not in self._asked:
            return [newest]
        between = self._memory.poses_since(edge.src, edge.dst, max(given, now - self._oldest))
        return [*(pose for pose in between if pose.stamp < newest.stamp), newest][-RECENT_PERCEPTS:]

    def _percept(self, edge: Edge, pose: Pose, stamp: float, now: float, places: _CameraPlaces) -> Percept | None:
        """None if it cannot be used, or not yet."""
        if stamp < now - self._oldest:
            self._given[edge.src, edge.dst] = stamp
            self._skip(edge, "too old", f"is {now - stamp:.1f} s old")
        elif stamp > now + MOST_AHEAD:
            self._skip(edge, "from the future", f"is stamped {stamp - now:.1f} s ahead")
        else:
            try:
                world_from_camera = places.world_from(edge.src, pose.stamp)
                if (far := math.hypot(*world_from_camera.t) + math.hypot(*pose.t)) <= FARTHEST:
                    return Percept(edge.src, edge.dst, stamp, pose, world_from_camera)
                self._given[edge.src, edge.dst] = stamp
                self._skip(edge, "too far", f"is up to {far:.3g} m from the world's origin; at most {FARTHEST}")
            except ExtrapolationError as error:
                self._skip(edge, "camera's place not known then", f"cannot be placed: {error}")
            except DsrError as error:
                self._skip(edge, "no chain to the world", f"cannot be placed: {error}")
        return None

    def _skip(self, edge: Edge, reason: str, why: str) -> None:
        self.skipped[reason] += 1
        self.problems[edge.dst] = f"percept of {edge.dst!r} from {edge.src!r} {why}"


class _CameraPlaces:
    """Where cameras were in one look: worked out once for all that an image shows."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._known: dict[tuple[str, float], Pose | DsrError] = {}

    def world_from(self, camera: str, stamp: float) -> Pose:
        """world_from_camera at that time (s); of stamp 0, the newest. Raises `DsrError` where it is not known."""
        known = self._known.get((camera, stamp))
        if known is None:
            try:
                known = self._memory.transform(WORLD, camera, at=stamp or None)
            except DsrError as error:
                known = error
            self._known[camera, stamp] = known
        if isinstance(known, DsrError):
            raise copy(known)  # each raising adds to the traceback of what is raised
        return known
