"""From the graph: new percepts in the world frame, and what is believed of each object, now and a moment ago."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from typing import NamedTuple

from dsr.errors import DsrError, ExtrapolationError
from dsr.graph.elements import Edge, Node
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose, interpolate
from dsr.memory import Memory
from dsr.vocabulary.relations import THINGS

WORLD = "world"

_MOST_AHEAD = 0.5  # s that a percept's stamp may be ahead of this machine's clock
_OLDEST = 1.0  # s, percepts older than that when they are found say nothing any more
_SAMPLES = 64  # of each object's belief
_SOON = 0.15  # s between two samples of a belief that is on its way; it rested between others


class Percept(NamedTuple):
    """One observation."""

    camera: str
    name: str
    """Of the object."""
    stamp: float
    """s"""
    pose: Pose
    """world_from_object"""
    eye: Vector3
    """m, of the camera in the world"""


class Percepts:
    """Finds what is new among the RT edges from cameras to objects. What cannot be used is counted."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._used: dict[tuple[str, str], Pose] = {}
        self.skipped: Counter[str] = Counter()
        """Percepts that could not be used, by reason."""

    def new(self, now: float) -> Iterator[Percept]:
        """Those not given before, by camera and object."""
        edges = [edge for camera in self._memory.nodes("camera") for edge in self._memory.edges("RT", src=camera.name)]
        self._used = {key: pose for key, pose in self._used.items() if self._memory.get_edge(*key, "RT") is not None}
        for edge in sorted(edges, key=lambda edge: edge.key):
            node, pose = self._memory.get_node(edge.dst), edge.get("pose")
            known = self._used.get((edge.src, edge.dst))
            if node is None or node.type not in THINGS or pose is None or pose is known:
                continue
            percept = self._percept(edge, pose, now)
            if percept is not None and (known is None or pose.stamp > known.stamp or pose.stamp == 0.0):
                yield percept

    def _percept(self, edge: Edge, pose: Pose, now: float) -> Percept | None:
        """None if it cannot be used; one whose camera's place then is not known yet is tried again."""
        stamp = pose.stamp or now
        try:
            if stamp <= now + _MOST_AHEAD and stamp >= now - _OLDEST:
                world_from_camera = self._memory.transform(WORLD, edge.src, at=pose.stamp or None)
                found = Percept(edge.src, edge.dst, stamp, world_from_camera @ pose, world_from_camera.t)
                self._used[edge.src, edge.dst] = pose
                return found
            self._skip("too old" if stamp < now else "from the future")
        except ExtrapolationError:
            self.skipped["camera's place not known then"] += 1
            return None
        except DsrError:
            self._skip("no chain to the world")
        self._used[edge.src, edge.dst] = pose
        return None

    def _skip(self, reason: str) -> None:
        self.skipped[reason] += 1


class Beliefs:
    """Where objects are believed to be (Virtual_RT), with their recent past."""

    def __init__(self, memory: Memory, jump: float, jump_turn: float) -> None:
        self._memory = memory
        self._jump = jump
        self._jump_turn = jump_turn
        self._samples: dict[str, deque[tuple[float, Pose]]] = {}

    def update(self, now: float, objects: list[Node], moving: set[str]) -> set[str]:
        """Take note of what is believed at `now` (s); those whose belief jumped.

        A belief in `moving` is on its way as it should be, and does not jump.
        """
        jumped = set()
        for node in objects:
            edge = self._memory.get_edge(WORLD, node.name, "Virtual_RT")
            pose = None if edge is None else edge.get("pose")
            if pose is None:
                self._samples.pop(node.name, None)
                continue
            samples = self._samples.setdefault(node.name, deque(maxlen=_SAMPLES))
            if not samples or samples[-1][1] is not pose:
                if samples and node.name not in moving and self._is_jump(samples[-1][1], pose):
                    jumped.add(node.name)
                samples.append((min(pose.stamp or now, now), pose))
        names = {node.name for node in objects}
        self._samples = {name: samples for name, samples in self._samples.items() if name in names}
        return jumped

    def now(self, name: str) -> Pose | None:
        """world_from_object; None if nothing is believed of it."""
        samples = self._samples.get(name)
        return samples[-1][1] if samples else None

    def at(self, name: str, stamp: float) -> Pose | None:
        """The same at an earlier time (s), as far back as is known."""
        later: tuple[float, Pose] | None = None
        for sample in reversed(self._samples.get(name, ())):
            if sample[0] <= stamp:
                return _between(sample, later, stamp)
            later = sample
        return later[1] if later else None

    def _is_jump(self, old: Pose, new: Pose) -> bool:
        metres, radians = old.distance(new)
        return metres > self._jump or radians > self._jump_turn


def _between(old: tuple[float, Pose], new: tuple[float, Pose] | None, stamp: float) -> Pose:
    """A belief that is on its way is between its samples; else it has stayed at the older one."""
    if new is None or not 0.0 < new[0] - old[0] <= _SOON:
        return old[1]
    return interpolate(old[1].with_stamp(old[0]), new[1].with_stamp(new[0]), stamp)
