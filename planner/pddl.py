"""The world state and a goal as a PDDL problem of etc/planning/domain.pddl, and names there and back."""

from __future__ import annotations

import re
from collections.abc import Iterable

from dsr.files.built_in import ETC
from dsr.vocabulary.goals import Goal
from dsr.vocabulary.relations import Relation
from planner.errors import GoalNotPossible
from planner.state import WorldState

DOMAIN = ETC / "planning" / "domain.pddl"
_PLAIN = re.compile(r"[a-z][a-z0-9_-]*")
_NOT_PLAIN = re.compile(r"[^a-z0-9_-]")
_RESERVED = frozenset({"and", "or", "not", "forall", "exists", "when", "imply", "either", "object", "thing", "number"})


class Names:
    """PDDL names of nodes: the same where that is possible, for PDDL knows no capitals and no dots."""

    def __init__(self, nodes: Iterable[str]) -> None:
        self._pddl: dict[str, str] = {}
        self._nodes: dict[str, str] = {}
        ordered = sorted(nodes, key=lambda name: (not _is_plain(name), name))
        for number, node in enumerate(ordered):
            name = node if _is_plain(node) else f"n{number}_{_NOT_PLAIN.sub('_', node.lower())}"
            while name in self._nodes:
                name += "_"
            self._pddl[node], self._nodes[name] = name, node

    def pddl(self, node: str) -> str:
        """The name of a node in PDDL."""
        return self._pddl[node]

    def node(self, name: str) -> str:
        """The node that is called `name` in PDDL. Raises `KeyError`."""
        return self._nodes[name]


def _is_plain(name: str) -> bool:
    return _PLAIN.fullmatch(name) is not None and name not in _RESERVED


def names_of(state: WorldState) -> Names:
    """PDDL names of all things of a state."""
    return Names(state.relations.things)


def problem(state: WorldState, goal: Goal) -> str:
    """The problem as text. Raises `GoalNotPossible` for a goal that the domain cannot express."""
    names = names_of(state)
    facts = sorted(_fact(fact, names) for fact in _initial(state))
    wanted = [_fact(_in_domain(relation, state), names) for relation in goal.relations]
    things = sorted(names.pddl(thing) for thing in state.relations.things)
    return "\n".join([
        f"; {goal}",
        "(define (problem now) (:domain tabletop)",
        f"  (:objects {' '.join(things)} - thing)" if things else "  (:objects)",
        f"  (:init{''.join(f'{chr(10)}    {fact}' for fact in facts)})",
        f"  (:goal (and{''.join(f'{chr(10)}    {fact}' for fact in wanted)})))",
        "",
    ])  # fmt: skip


def _initial(state: WorldState) -> set[Relation]:
    relations = state.relations
    facts = {Relation("on", pair) for pair in relations.on if pair[1] in relations.things}
    facts |= {Relation("ontable", (thing,)) for thing, support in relations.on if support in relations.tables}
    for name, things in (
        ("holding", relations.held),
        ("taken", relations.taken),
        ("graspable", state.graspable),
        ("flat", state.flat),
    ):
        facts |= {Relation(name, (thing,)) for thing in things}
    return facts


def _in_domain(relation: Relation, state: WorldState) -> Relation:
    """The relation as the domain has it: there, a table is no thing."""
    things, tables = state.relations.things, state.relations.tables
    if relation.name == "on" and relation.arguments[1] in tables:
        if relation.arguments[1] != state.table:
            raise GoalNotPossible(f"{relation}: things can be put on {state.table!r} only")
        relation = Relation("ontable", relation.arguments[:1])
    for thing in relation.arguments:
        if thing in tables:
            raise GoalNotPossible(f"{relation}: {thing!r} is a table, and stays where it is")
        if thing not in things:
            raise GoalNotPossible(f"{relation}: {thing!r} is not believed to be anywhere")
    return relation


def _fact(relation: Relation, names: Names) -> str:
    return f"({' '.join((relation.name, *map(names.pddl, relation.arguments)))})"
