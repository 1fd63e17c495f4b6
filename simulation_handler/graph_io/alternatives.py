"""From the belief's islands to the graph: where each thing may be, while there is more than one way."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Iterator, Sequence

from dsr.believing.distribution import (
    ATTRIBUTE,
    SAME_PLACE,
    Alternative,
    Whereabouts,
    are_at_one_place,
    encoded,
    whereabouts_of,
)
from dsr.believing.worlds import BeliefWorlds
from dsr.errors import GraphError
from dsr.frames.tree import WORLD
from dsr.math3d.tolerance import SAME_POSE, PoseTolerance
from dsr.math3d.transforms import Pose, position_deviation
from dsr.memory import Memory
from dsr.perception.scales import RESOLUTION, SAME_OUTCOME
from dsr.vocabulary.relations import THINGS
from simulation_handler.worlds.model import Island, ObjectState

LEAST = 0.02
"""1, probability from which an alternative is told"""


class AlternativesWriter:
    """Writes the attribute `whereabouts` of things that may be in several ways, and the worlds `belief_1`, ... ."""

    def __init__(self, memory: Memory, most: int, near: PoseTolerance = SAME_POSE) -> None:
        """Write to a memory.

        Args:
            memory: the base world.
            most: how many of those worlds there may be at a time.
            near: up to which places differ by noise: alternatives that are all known so well, and so near, are one.
        """
        self._memory = memory
        self._near = near
        self._worlds = BeliefWorlds(memory, most)
        self._told: dict[str, Whereabouts] | None = None

    def update(self, islands: Collection[Island]) -> None:
        """Write what has changed. What an earlier run told of things that were not seen since stays."""
        changed = self._told is None
        if self._told is None:
            self._told = dict(self._told_before())
        judged = {name for island in islands for name in island.names}
        found = {where.name: where for island in islands for where in distributions(island, self._near)}
        for name in sorted((self._told.keys() & judged) - found.keys()):
            changed = True
            del self._told[name]
            with contextlib.suppress(GraphError):
                self._memory.update_node(name, **{ATTRIBUTE: ""})
        for name, where in found.items():
            node = self._memory.get_node(name)
            edge = self._memory.get_edge(WORLD, name, "Virtual_RT")
            shown = None if edge is None else edge.get("pose")
            if node is not None and not (node.get(ATTRIBUTE) and _is_same(self._told.get(name), where, shown)):
                changed = True
                with contextlib.suppress(GraphError):
                    self._memory.update_node(name, **{ATTRIBUTE: encoded(where, shown)})
                    self._told[name] = where
        if changed:
            self._worlds.update()

    def _told_before(self) -> Iterator[tuple[str, Whereabouts]]:
        """What an earlier run wrote."""
        for node in self._memory.nodes(THINGS):
            if node.get(ATTRIBUTE):
                where = whereabouts_of(node, self._memory.get_edge(WORLD, node.name, "Virtual_RT"))
                if where is not None:
                    yield node.name, where

    def close(self) -> None:
        """Delete the worlds."""
        self._worlds.close()


def distributions(island: Island, near: PoseTolerance = SAME_POSE) -> Iterator[Whereabouts]:
    """Where each thing of an island may be, of those that may be in several ways; improbable ones are left out.

    `near` is as of `AlternativesWriter`.
    """
    kept = [world for world in island.worlds if world.weight >= LEAST]
    total = sum(world.weight for world in kept)
    if len(kept) < 2:
        return
    weights = tuple(world.weight / total for world in kept)
    for name in island.names:
        alternatives: list[Alternative] = []
        for index, world in enumerate(kept):
            if (state := world.objects.get(name)) is not None:
                _add(alternatives, state, world.reason, weights[index], index, near)
        if len(alternatives) > 1:
            alternatives[1:] = sorted(alternatives[1:], key=lambda one: -one.weight)
            yield Whereabouts(name, tuple(alternatives), island.names, weights)


def _add(
    alternatives: list[Alternative], state: ObjectState, reason: str, weight: float, index: int, near: PoseTolerance
) -> None:
    """Add a state of one world, to the alternative that it equals if there is one."""
    for position, one in enumerate(alternatives):
        if one.holders == (state.hand, state.containers, state.supports) and _at_one_place(one, state, near):
            alternatives[position] = _more(one, weight, index)
            return
    alternatives.append(
        Alternative(
            weight=weight, pose=state.pose, reason=reason, hand=state.hand, containers=state.containers,
            supports=state.supports, worlds=(index,),
        )
    )  # fmt: skip


def _more(one: Alternative, weight: float, index: int) -> Alternative:
    return Alternative(
        weight=one.weight + weight, pose=one.pose, reason=one.reason, hand=one.hand, containers=one.containers,
        supports=one.supports, worlds=(*one.worlds, index),
    )  # fmt: skip


def _at_one_place(one: Alternative, state: ObjectState, near: PoseTolerance) -> bool:
    if one.pose is None or state.pose is None:
        return one.pose is state.pose
    if one.pose.cov == state.pose.cov and PoseTolerance(RESOLUTION, near.radians).covers(one.pose, state.pose):
        return True
    is_known = max(_deviation(one.pose), _deviation(state.pose)) < near.metres
    return is_known and near.covers(one.pose, state.pose)


def _deviation(pose: Pose) -> float:
    """m, standard deviation of a place; infinite if that is not known."""
    return math.inf if pose.cov is None else position_deviation(pose)


def _is_same(told: Whereabouts | None, where: Whereabouts, shown: Pose | None) -> bool:
    """Whether what was told last still says the same, up to the tolerances; `shown` is the pose of the edge."""
    best, follows = where.best.pose, True
    if best is not None and shown is not None:
        follows = SAME_PLACE.covers(best, shown)
    if told is None or told.island != where.island or len(told.weights) != len(where.weights):
        return False
    pairs = list(zip(told.alternatives, where.alternatives, strict=False))
    return (
        len(told.alternatives) == len(where.alternatives)
        and _are_close(told.weights, where.weights)
        and all(_is_same_alternative(old, new, (told.best, where.best), follows=follows) for old, new in pairs)
    )


def _are_close(old: Sequence[float], new: Sequence[float]) -> bool:
    return all(abs(one - other) <= LEAST for one, other in zip(old, new, strict=True))


def _is_same_alternative(
    old: Alternative, new: Alternative, best: tuple[Alternative, Alternative], *, follows: bool
) -> bool:
    """Whether an alternative is as it was: within a standard deviation of where it was told to be.

    What is where the `best` was and is follows the edge, if that one does.
    """
    if (old.holders, old.reason, old.worlds, old.is_gone) != (new.holders, new.reason, new.worlds, new.is_gone):
        return False
    if (follows and new is best[1]) or old.pose is None or new.pose is None:
        return True
    before, now = position_deviation(old.pose), position_deviation(new.pose)
    same = max(SAME_OUTCOME, min(before, now))
    if abs(before - now) > max(SAME_OUTCOME, 0.5 * before):  # else a place that gets sure would stay as it was told
        return False
    if follows and are_at_one_place(old, best[0]) and are_at_one_place(new, best[1]):
        return True
    return math.dist(old.pose.t, new.pose.t) <= same
