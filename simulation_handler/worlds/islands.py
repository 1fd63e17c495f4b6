"""Joins the worlds of single objects into islands: what goes along with another object is judged together with it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from dsr.math3d.transforms import Pose
from simulation_handler.contact.relations import Relation
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld, joined

MOST_WORLDS = 24
"""Worlds of one island; the least probable beyond are left out"""


def islands_of(worlds: Mapping[str, Sequence[WeightedWorld]], contents: Collection[Relation]) -> list[Island]:
    """Islands of objects and of what goes along with them.

    Args:
        worlds: those of each object alone, the most probable first, with a sum of 1: one to `MOST_WORLDS`.
        contents: pairs (object, container) of which the object goes along with the container, and is not seen.
    """
    pairs = [pair for pair in contents if pair[0] in worlds and pair[1] in worlds]
    return [Island(names, _joint(names, worlds, pairs)) for names in joined(pairs, list(worlds))]


def _joint(
    names: Sequence[str], worlds: Mapping[str, Sequence[WeightedWorld]], pairs: Collection[Relation]
) -> tuple[WeightedWorld, ...]:
    """The most probable combinations, containers before what is in them."""
    if len(names) == 1:
        return tuple(worlds[names[0]])
    depth = {name: sum(inner == name for inner, _ in pairs) for name in names}
    found = [WeightedWorld(1.0, {})]
    for name in sorted(names, key=lambda name: (depth[name], name)):
        combined = [_with(world, name, one, worlds) for world in found for one in worlds[name]]
        found = sorted(combined, key=lambda world: -world.weight)[:MOST_WORLDS]
    total = sum(world.weight for world in found)
    return tuple(world._replace(weight=world.weight / total) for world in found)


def _with(
    world: WeightedWorld, name: str, one: WeightedWorld, worlds: Mapping[str, Sequence[WeightedWorld]]
) -> WeightedWorld:
    """A world and one more object, which goes along with its container if that is elsewhere in this world."""
    state = one.objects[name]
    if state.container in world.objects and state.pose is not None:
        state = _gone_along(state, world.objects[state.container], worlds[state.container][0].objects[state.container])
    reasons = ", ".join(reason for reason in (world.reason, one.reason) if reason)
    return WeightedWorld(world.weight * one.weight, {**world.objects, name: state}, reasons)


def _gone_along(state: ObjectState, container: ObjectState, most_probable: ObjectState) -> ObjectState:
    """The state of an object if its container is not where it most probably is."""
    if container.pose is None or most_probable.pose is None or state.pose is None:
        return ObjectState(None) if container.pose is None else state
    if (container.pose.t, container.pose.q) == (most_probable.pose.t, most_probable.pose.q):
        return state
    there = _bare(container.pose) @ _bare(most_probable.pose).inverse() @ _bare(state.pose)
    return state._replace(pose=Pose.unchecked(there.t, there.q, state.pose.stamp, state.pose.cov))


def _bare(pose: Pose) -> Pose:
    return Pose.unchecked(pose.t, pose.q)
