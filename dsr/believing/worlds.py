"""The leading alternatives of the belief as worlds of the memory: overlays `belief_1`, ... of the base."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dsr.believing.distribution import (
    ATTRIBUTE,
    SAME_PLACE,
    Alternative,
    Whereabouts,
    are_at_one_place,
    whereabouts_of,
)
from dsr.errors import DsrError
from dsr.frames.tree import WORLD
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.relations import THINGS

PREFIX = "belief_"
"""Beginning of the names of these worlds."""
MOST_WORLDS = 3
"""count of these worlds at a time, unless somebody asks for more"""
LEAST = 0.05
"""1, probability from which an alternative is worth a world"""
_SAME = 0.02  # 1, by which a weight may change before it is written again
_SOURCE = "alternative"  # `source` of relations that are so in an alternative only


@dataclass(frozen=True)
class BeliefWorld:
    """One alternative of an island: what is otherwise in it than in the world that is believed most."""

    island: tuple[str, ...]
    """Names of the things that are judged together"""
    weight: float
    """1, its probability among the alternatives of its island"""
    things: Mapping[str, Alternative]
    """Of each thing that is otherwise, how it is then"""

    @property
    def reason(self) -> str:
        """What would have happened, in words."""
        return "; ".join(f"{name}: {one.reason}" for name, one in sorted(self.things.items()) if one.reason)

    def goes_on(self, other: BeliefWorld) -> bool:
        """Whether this is the same alternative at another time."""
        mine, theirs = ({name: (one.holders, one.is_gone) for name, one in world.things.items()}
                        for world in (self, other))  # fmt: skip
        return self.island == other.island and mine == theirs and self.reason == other.reason


def leading(memory: Memory, most: int) -> list[BeliefWorld]:
    """The most probable alternatives to what is believed most, the best first, by what nodes say."""
    found: dict[tuple[tuple[str, ...], int], dict[str, Alternative]] = {}
    weights: dict[tuple[tuple[str, ...], int], float] = {}
    for where in _distributions(memory):
        for index in range(1, len(where.weights)):
            one = next((one for one in where.alternatives if index in one.worlds), None)
            if one is not None and _is_otherwise(one, where.best):
                found.setdefault((where.island, index), {})[where.name] = one
                weights[where.island, index] = where.weights[index]
    worlds = [BeliefWorld(island, weights[island, index], things) for (island, index), things in found.items()]
    worlds = [world for world in worlds if world.weight >= LEAST]
    return sorted(worlds, key=lambda world: (-world.weight, world.island))[:most]


def _distributions(memory: Memory) -> Iterator[Whereabouts]:
    for node in memory.nodes(THINGS):
        if node.get(ATTRIBUTE):
            where = whereabouts_of(node, memory.get_edge(WORLD, node.name, "Virtual_RT"))
            if where is not None:
                yield where


def _is_otherwise(one: Alternative, best: Alternative) -> bool:
    """Whether a thing is elsewhere, or with others; not only less certain where it is."""
    if one.holders != best.holders or one.is_gone != best.is_gone:
        return True
    return not are_at_one_place(one, best)


class BeliefWorlds:
    """Keeps worlds in step with the leading alternatives: writes changes only, removes what is believed no more.

    Args:
        memory: the base world.
        most: worlds at a time.
    """

    def __init__(self, memory: Memory, most: int) -> None:
        self._memory = memory
        self._most = most
        self._open: dict[str, BeliefWorld] = {}

    def update(self) -> None:
        """Bring the worlds into step with what the nodes say now. Raises nothing for worlds that others delete."""
        wanted = leading(self._memory, self._most)
        kept: dict[str, BeliefWorld] = {}
        for name, world in self._open.items():
            again = next((one for one in wanted if one.goes_on(world)), None)
            if again is not None:
                kept[name] = again
                wanted.remove(again)
        free = iter([name for number in range(1, self._most + 1) if (name := f"{PREFIX}{number}") not in kept])
        for world in wanted:
            kept[next(free)] = world
        for name in self._stale(kept):
            with contextlib.suppress(DsrError):
                self._memory.delete_world(name)
        for name, world in kept.items():
            with contextlib.suppress(DsrError):
                self._show(name, world, self._open.get(name))
        self._open = kept

    def close(self) -> None:
        """Delete the worlds."""
        for name in self._open:
            with contextlib.suppress(DsrError):
                self._memory.delete_world(name)
        self._open = {}

    def _stale(self, kept: Mapping[str, BeliefWorld]) -> list[str]:
        """Names of worlds that are wanted no more, or hold another alternative; also those that an earlier run left."""
        there = [info.name for info in self._memory.worlds() if info.name.startswith(PREFIX)]
        return [
            name for name in there
            if name not in kept or name not in self._open or not kept[name].goes_on(self._open[name])
        ]  # fmt: skip

    def _show(self, name: str, world: BeliefWorld, before: BeliefWorld | None) -> None:
        """Write into the overlay what is otherwise in it."""
        known = {info.name for info in self._memory.worlds()}
        overlay = self._memory.world(name) if name in known else self._memory.fork(name, follow=True)
        root = overlay.node(WORLD)
        weight = root.get("weight")
        things = ", ".join(sorted(world.things))
        if weight is None or abs(weight - world.weight) > _SAME or root.get("things") != things:
            overlay.update_node(WORLD, weight=round(world.weight, 3), things=things, note=world.reason)
        for thing, one in world.things.items():
            told = None if before is None else before.things.get(thing)
            self._place(overlay, thing, one.pose)
            if told is None or told.holders != one.holders:
                self._relate(overlay, thing, one)

    def _place(self, overlay: Memory, thing: str, pose: Pose | None) -> None:
        edge = overlay.get_edge(WORLD, thing, "Virtual_RT")
        if pose is None:
            if edge is not None:
                overlay.remove_edge(WORLD, thing, "Virtual_RT")
            if overlay.node(thing).get("present") is not False:
                overlay.update_node(thing, present=False)
            return
        shown = None if edge is None else edge.get("pose")
        if shown is None or not SAME_PLACE.covers(shown, pose):
            overlay.add_edge(WORLD, thing, "Virtual_RT", pose=pose)
        if overlay.node(thing).get("present") is False:
            overlay.update_node(thing, present=True)

    def _relate(self, overlay: Memory, thing: str, one: Alternative) -> None:
        """Let what a thing is on and in, and who holds it, be as in the alternative."""
        wanted = {
            *((thing, support, "on") for support in one.supports),
            *((thing, container, "in") for container in one.containers),
            *([(one.hand, thing, "grasping")] if one.hand else []),
        }
        for kind, ends in (("on", {"src": thing}), ("in", {"src": thing}), ("grasping", {"dst": thing})):
            for edge in overlay.edges(kind, **ends):
                if (edge.src, edge.dst, kind) not in wanted:
                    overlay.remove_edge(edge.src, edge.dst, kind)
        for src, dst, kind in sorted(wanted):
            if overlay.get_edge(src, dst, kind) is None:
                overlay.add_edge(src, dst, kind, source=_SOURCE)
