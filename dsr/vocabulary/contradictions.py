"""Finds relations of a goal that hold together in no world, by their meaning."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

from dsr.vocabulary.goals import Goal
from dsr.vocabulary.relations import Relation

Why = Callable[[Relation, Relation, frozenset[str]], str]
"""Why two relations cannot hold together, given the tables; empty if they can."""


class Conflict(NamedTuple):
    """Relations that cannot be made to hold together, or a single one that cannot be made to hold."""

    relations: tuple[Relation, ...]
    reason: str

    def __str__(self) -> str:
        excluded = "exclude each other" if len(self.relations) > 1 else "cannot be brought about"
        return f"{listed(self.relations)} {excluded}: {self.reason}"


def listed(relations: Sequence[Relation]) -> str:
    """Relations as text: `on(a,b), on(b,c) and on(c,a)`."""
    *first, last = map(str, relations)
    return f"{', '.join(first)} and {last}" if first else last


def by_meaning(goal: Goal) -> Conflict | None:
    """Relations that hold together in no world."""
    return next(_cycles(goal), None) or next(pairs(goal, _no_world), None)


def pairs(goal: Goal, why: Why, tables: frozenset[str] = frozenset()) -> Iterator[Conflict]:
    """Pairs of relations of a goal for which `why`, asked in both orders with these `tables`, has a reason."""
    for one, other in combinations(goal.relations, 2):
        if reason := why(one, other, tables) or why(other, one, tables):
            yield Conflict((one, other), reason)


def _cycles(goal: Goal) -> Iterator[Conflict]:
    """Towers that would stand on themselves; the smallest of those that begin with the same thing."""
    resting = [relation for relation in goal.relations if relation.name == "on"]
    for first in resting:
        chains: list[tuple[Relation, ...]] = [(first,)]
        reached = {first.arguments[1]}
        while chains:
            chain = chains.pop(0)
            if chain[-1].arguments[1] == first.arguments[0]:
                yield Conflict(chain, f"{first.arguments[0]} would rest on itself")
                return
            below = [r for r in resting if r.arguments[0] == chain[-1].arguments[1] and r.arguments[1] not in reached]
            reached |= {relation.arguments[1] for relation in below}
            chains += [(*chain, relation) for relation in below]


def _no_world(one: Relation, other: Relation, _: frozenset[str]) -> str:
    """By what the relations mean."""
    if (one.name, other.name) == ("holding", "handempty"):
        return f"a gripper that holds {one.arguments[0]} is not empty"
    if (one.name, other.name) == ("on", "clear") and one.arguments[1] == other.arguments[0]:
        return f"with {one.arguments[0]} on it, {other.arguments[0]} is not clear"
    if (one.name, other.name) == ("holding", "clear") and one.arguments == other.arguments:
        return "what is held is not clear"
    return ""
