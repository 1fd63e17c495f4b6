"""Which relations of a goal the arm cannot bring about as things are now, as far as that shows without a search."""

from __future__ import annotations

from collections.abc import Sequence

from dsr.vocabulary.contradictions import Conflict, listed, pairs
from dsr.vocabulary.goals import Goal
from dsr.vocabulary.relations import Relation, Relations
from planner.config import PlannerConfig
from planner.state import FLAT, WorldState


def by_state(goal: Goal, state: WorldState, config: PlannerConfig) -> Conflict | None:
    """Relations that the arm cannot bring about as things are now.

    What holds already may be what the arm could not do: a board that rests on two cubes.
    """
    relations = state.relations
    for conflict in pairs(goal, _no_plan, relations.tables):
        if not all(map(relations.holds, conflict.relations)):
            return conflict
    for relation in goal.missing(relations):
        if reason := _obstacle(relation, state, config):
            return Conflict((relation,), reason)
    return None


def searched(part: Sequence[Relation], surely: bool) -> str:
    """Explain in words a set of relations to which no plan leads, as the solver found it; `surely` none can be left
    out.
    """
    if len(part) == 1:
        return f"no plan leads to {part[0]} as things are now"
    among = "" if surely else ", or some of them exclude each other"
    return f"no plan leads to {listed(part)} together as things are now{among}"


# ---- relations with each other


def _no_plan(one: Relation, other: Relation, tables: frozenset[str]) -> str:
    """By what the arm can do."""
    rests = one.name in ("on", "ontable")
    if rests and other.name in ("on", "ontable"):
        if one.arguments[0] == other.arguments[0]:
            return "" if _on_table(one, tables) and _on_table(other, tables) else _one_support(one)
        if one.arguments[1:] == other.arguments[1:] and one.name == "on" and not _on_table(one, tables):
            return f"only one thing can be put on {one.arguments[1]}"
    if other.name == "holding":
        held = other.arguments[0]
        if one.name == "holding":
            return "the gripper can hold one thing only"
        if rests and one.arguments[0] == held:
            return f"{held} cannot be put down and held"
        if one.name == "on" and one.arguments[1] == held:
            return f"nothing can be put on {held} while it is held"
    return ""


def _on_table(relation: Relation, tables: frozenset[str]) -> bool:
    return relation.name == "ontable" or relation.arguments[1] in tables


def _one_support(relation: Relation) -> str:
    return f"{relation.arguments[0]} can be put on one thing only"


# ---- relations by themselves


def _obstacle(relation: Relation, state: WorldState, config: PlannerConfig) -> str:
    """Why the arm cannot bring about a relation that does not hold; empty if nothing is known against it."""
    relations = state.relations
    if taken := relations.taken.intersection(relation.arguments):
        return f"somebody else holds {min(taken)}"
    if relation.name == "on":
        support = relation.arguments[1]
        if support in relations.things - state.flat:
            return f"nothing can be put on {support}, only on {' or '.join(f'a {kind}' for kind in FLAT)}"
    for thing in sorted(_to_be_lifted(relation, relations)):
        if thing not in state.graspable:
            return f"{thing} would have to be lifted, but {_ungraspable(thing, state, config)}"
    return ""


def _to_be_lifted(relation: Relation, relations: Relations) -> set[str]:
    """What must be lifted on any way to a relation that does not hold."""
    lifted: set[str] = set()
    for position, name in enumerate(relation.arguments):
        itself = position == 0 and relation.name != "clear"
        if not (itself and name in relations.held):
            lifted |= _above(name, relations) | ({name} if itself else set())
    return (lifted & relations.things) - relations.held


def _above(name: str, relations: Relations) -> set[str]:
    """All that rests on a thing, and on that."""
    found: set[str] = set()
    new = set() if name in relations.tables else {name}
    while new:
        new = {above for above, support in relations.on if support in new} - found
        found |= new
    return found


def _ungraspable(thing: str, state: WorldState, config: PlannerConfig) -> str:
    solid = state.solids.get(thing)
    if thing in state.relations.taken:
        return "somebody else holds it"
    if solid is None:
        return "its size or pose is not known"
    width, widest = min(solid.size[:2]), config.widest_grip
    return f"it is {width * 1000:.0f} mm wide, and the gripper grasps up to {widest * 1000:.0f} mm"
