"""Expectations about worlds beside the base: what is known in them, which there are; and how they are looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from agents.scenario.format.expectations import Edges, KnownIn, WorldsCheck
from agents.scenario.format.model import Scenario
from agents.scenario.judge.findings import Finding, begin_of, each, mm, pairs
from agents.scenario.truth.history import History, Sample, WorldSample
from dsr.errors import TransportError, WorldNotFoundError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import BASE
from dsr.vocabulary.relations import is_present


class WorldWatch:
    """Looks into the worlds that expectations are about, whenever they are there.

    Args:
        scenario: what is expected.
        memory: of the base.
    """

    def __init__(self, scenario: Scenario, memory: Memory) -> None:
        self._memory = memory
        self._objects = [spec.name for spec in scenario.objects]
        checks = [check for check in scenario.expectations if isinstance(check, Edges | KnownIn)]
        self._wanted = {check.world for check in checks} - {BASE}
        self._kinds = {check.type for check in checks if isinstance(check, Edges)}

    def look(self) -> dict[str, WorldSample | None]:
        """Read the present worlds; a world that cannot be opened counts as not there."""
        found: dict[str, WorldSample | None] = {}
        for info in self._memory.worlds():
            if info.name == BASE:
                continue
            if info.name not in self._wanted:
                found[info.name] = None
                continue
            try:
                found[info.name] = self._look_into(self._memory.world(info.name))
            except (WorldNotFoundError, TransportError):
                continue
        return found

    def _look_into(self, world: Memory) -> WorldSample:
        places, perceived = {}, set()
        for name in self._objects:
            node = world.get_node(name)
            if node is None or not is_present(node):
                continue
            pose = world.get_transform(WORLD, name, types=BELIEVED)
            if pose is not None:
                places[name] = pose
            if node.get("perceived") is True:
                perceived.add(name)
        edges = frozenset((edge.type, edge.src, edge.dst) for kind in self._kinds for edge in world.edges(kind))
        return WorldSample(places, frozenset(perceived), edges)


def edges_in_world(check: Edges, history: History, sample: Sample) -> Finding:
    """Judge whether edges are in another world than the base."""
    found: set[tuple[str, str]] = set()
    for one in _samples(check, history, sample):
        world = one.worlds.get(check.world)
        if world is None:
            return False, f"no world {check.world!r} at {one.time:.2f} s"
        found = {(src, dst) for kind, src, dst in world.edges if kind == check.type}
        if not (found.issuperset(check.present) and found.isdisjoint(check.absent)):
            return False, f"{pairs(found)} at {one.time:.2f} s"
    return True, pairs(found)


def _known_in(check: KnownIn, history: History, sample: Sample) -> Finding:
    samples = [*_samples(check, history, sample)]

    def find(name: str) -> Finding:
        found = (True, "never looked")
        for one in samples:
            found = _known_at(check, one, name)
            if not found[0]:
                return False, f"{found[1]} at {one.time:.2f} s"
        return found

    return each(check, sample, find)


def _known_at(check: KnownIn, sample: Sample, name: str) -> Finding:
    world = sample.worlds.get(check.world)
    if world is None:
        return False, f"no world {check.world!r}"
    place = world.places.get(name)
    if place is None or not check.value:
        return (place is None) is not check.value, "nowhere" if place is None else f"at {_shown(place)}"
    holds, what = True, f"at {_shown(place)}"
    if check.position is not None:
        holds = place.distance(Pose(check.position))[0] <= check.tolerance
    if check.right is not None:
        true = sample.truth.get(name)
        error = None if true is None else place.distance(true)[0]
        holds = holds and (error is not None and error <= check.tolerance) is check.right
        what += ", not in the true world" if error is None else f", {mm(error)} off"
    if check.perceived is not None:
        holds = holds and (name in world.perceived) is check.perceived
        what += ", perceived" if name in world.perceived else ", not perceived"
    return holds, what


def _worlds(check: WorldsCheck, history: History, sample: Sample) -> Finding:
    def holds(one: Sample) -> bool:
        return one.worlds.keys() >= set(check.present) and one.worlds.keys().isdisjoint(check.absent)

    if check.ever:
        window = history.window(begin_of(check, history, 0.0) or 0.0, sample.time)
        moment = next((one for one in window if holds(one)), None)
        return (False, "never") if moment is None else (True, f"at {moment.time:.2f} s")
    for one in _samples(check, history, sample):
        if not holds(one):
            return False, f"{', '.join(sorted(one.worlds)) or 'none'} at {one.time:.2f} s"
    return True, ", ".join(sorted(sample.worlds)) or "none"


def _samples(check: Edges | KnownIn | WorldsCheck, history: History, sample: Sample) -> Iterable[Sample]:
    begin = begin_of(check, history, None)
    return [sample] if begin is None else history.window(begin, sample.time)


def _shown(pose: Pose) -> str:
    return "({:.3f}, {:.3f}, {:.3f})".format(*pose.t)


WORLDS: dict[type, Callable[[Any, History, Sample], Finding]] = {KnownIn: _known_in, WorldsCheck: _worlds}
"""How each of these checks is judged."""
