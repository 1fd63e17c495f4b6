"""From the graph: the belief about each object, now and a moment ago: poses, and all places where it may be."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from typing import TypeVar

from dsr.believing.distribution import Whereabouts
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose, interpolate
from dsr.memory import Memory
from dsr.perception.scales import ONE_MOMENT
from surprise.evidence import KEPT

T = TypeVar("T")

LATENCY = ONE_MOMENT
"""s by which a belief and what cameras show may be apart. Samples of a belief that is on its way come sooner."""


class Beliefs:
    """The believed poses of objects (Virtual_RT), with their recent past."""

    def __init__(self, memory: Memory, fresh: float, calm: PoseTolerance) -> None:
        """`fresh`: s between two percepts that are one evidence; what was believed before all of it is remembered."""
        self._memory = memory
        self._remembered = KEPT * fresh
        self._calm = calm
        self._samples: dict[str, deque[tuple[float, Pose]]] = {}
        self._since: dict[str, float] = {}

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
            samples = self._samples.setdefault(node.name, deque())
            if not samples or samples[-1][1] is not pose:
                stamp = min(pose.stamp or now, now)
                if samples and node.name not in moving and not self._calm.covers(samples[-1][1], pose):
                    jumped.add(node.name)
                if not samples or node.name in jumped:
                    self._since[node.name] = stamp
                samples.append((stamp, pose))
            _forget(samples, now - self._remembered)
        names = {node.name for node in objects}
        self._samples = {name: samples for name, samples in self._samples.items() if name in names}
        self._since = {name: since for name, since in self._since.items() if name in self._samples}
        return jumped

    def now(self, name: str) -> Pose | None:
        """world_from_object; None if nothing is believed of it."""
        samples = self._samples.get(name)
        return samples[-1][1] if samples else None

    def since(self, name: str) -> float:
        """s, when the belief jumped last, or began: earlier ones are void. -inf if nothing is believed."""
        return self._since.get(name, -math.inf)

    def before(self, name: str, stamp: float) -> Pose | None:
        """world_from_object as it was believed before a time (s): what percepts of that time led to is not in it.

        Not from before the last jump. None if nothing is believed of it.
        """
        found = None
        for time, pose in reversed(self._samples.get(name, ())):
            if time < self.since(name):
                break
            found = pose
            if time < stamp:
                break
        return found

    def at(self, name: str, stamp: float) -> Pose | None:
        """The same at an earlier time (s), as far back as is known."""
        later: tuple[float, Pose] | None = None
        for sample in reversed(self._samples.get(name, ())):
            if sample[0] <= stamp:
                return _between(sample, later, stamp)
            later = sample
        return later[1] if later else None


class PastWhereabouts:
    """Where objects may be by the belief, as it was told lately."""

    def __init__(self, memory: Memory, fresh: float) -> None:
        """`fresh`: s between two percepts that are one evidence; what was told before all of it is remembered."""
        self._memory = memory
        self._remembered = KEPT * fresh
        self._told: dict[str, deque[tuple[float, Whereabouts]]] = {}

    def note(self, now: float, names: Collection[str]) -> None:
        """Keep what the belief tells at `now` (s) of these objects, and forget others."""
        self._told = {name: self._told.get(name, deque()) for name in names}
        for name, told in self._told.items():
            where = self._memory.belief(name)
            if where is not None:
                told.append((now, where))
            _forget(told, now - self._remembered)

    def before(self, name: str, stamp: float, since: float) -> Whereabouts | None:
        """Where an object might be before a time (s), by what was told from `since` (s) on; None if nothing is."""
        found = None
        for time, where in reversed(self._told.get(name, ())):
            if time < since:
                break
            found = where
            if time < stamp:
                break
        return found or self._memory.belief(name)


def _forget(samples: deque[tuple[float, T]], before: float) -> None:
    """Drop all samples but the last one from before a time (s), which holds until the next."""
    while len(samples) > 1 and samples[1][0] < before:
        samples.popleft()


def _between(old: tuple[float, Pose], new: tuple[float, Pose] | None, stamp: float) -> Pose:
    """A belief that is on its way is between its samples; else it has stayed at the older one."""
    if new is None or not 0.0 < new[0] - old[0] <= LATENCY:
        return old[1]
    return interpolate(old[1].with_stamp(old[0]), new[1].with_stamp(new[0]), stamp)
