"""From the graph: the belief about each object, now and a moment ago."""

from __future__ import annotations

from collections import deque

from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose, interpolate
from dsr.memory import Memory

_SAMPLES = 64  # of each object's belief
_SOON = 0.15  # s between two samples of a belief that is on its way; it rested between others


class Beliefs:
    """The believed poses of objects (Virtual_RT), with their recent past."""

    def __init__(self, memory: Memory, calm: PoseTolerance) -> None:
        self._memory = memory
        self._calm = calm
        self._samples: dict[str, deque[tuple[float, Pose]]] = {}

    def update(self, now: float, objects: list[Node], moving: set[str]) -> set[str]:
        """Take note of the beliefs at `now` (s), and return the objects whose belief jumped.

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
                if samples and node.name not in moving and not self._calm.covers(samples[-1][1], pose):
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


def _between(old: tuple[float, Pose], new: tuple[float, Pose] | None, stamp: float) -> Pose:
    """A belief that is on its way is between its samples; else it has stayed at the older one."""
    if new is None or not 0.0 < new[0] - old[0] <= _SOON:
        return old[1]
    return interpolate(old[1].with_stamp(old[0]), new[1].with_stamp(new[0]), stamp)
