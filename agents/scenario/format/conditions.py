"""Conditions on the true world that start an event: `built(cube_3, cube_4) and resting(cube_6)`."""

from __future__ import annotations

import re
from collections.abc import Callable

import msgspec

from dsr.errors import ConfigError, suggest

PREDICATES = {
    "built": 2,
    "resting": 1,
    "lifted": 1,
    "held": 1,
    "lowering": 2,
    "idle": 0,
}
"""Name and number of objects of each predicate.

`built(a, b)`: a stands on b and neither moves; `resting(a)`: a is supported and does not move; `lifted(a)`:
a is more than 10 mm above whatever lies below it; `held(a)`: a is in the gripper; `lowering(a, b)`: a is in the
gripper, over b and less than 20 mm above it; `idle()`: the gripper is empty and the arm does not move.
"""
OF_ROBOT = frozenset({"held", "lowering", "idle"})
"""Predicates on the robot: without one they never become true, or are from the start."""

_TERM = re.compile(r"\s*(\w+)\s*\(([^()]*)\)\s*")


class Term(msgspec.Struct, frozen=True):
    """One predicate with the names of its objects."""

    predicate: str
    objects: tuple[str, ...]


class Condition(msgspec.Struct, frozen=True):
    """Terms that must all hold at the same time."""

    terms: tuple[Term, ...]

    def holds(self, is_true: Callable[[Term], bool]) -> bool:
        """Whether `is_true` says so of every term."""
        return all(is_true(term) for term in self.terms)

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of all objects in the condition."""
        return tuple(name for term in self.terms for name in term.objects)


def parse_condition(text: str) -> Condition:
    """The condition written as `predicate(object, ...) and ...`. Raises `ConfigError`."""
    return Condition(tuple(_parse_term(part) for part in re.split(r"\band\b", text)))


def _parse_term(text: str) -> Term:
    match = _TERM.fullmatch(text)
    if not match:
        raise ConfigError(f"condition {text.strip()!r}: expected 'predicate(object, ...)', joined by 'and'")
    predicate, arguments = match.groups()
    if predicate not in PREDICATES:
        raise ConfigError(f"unknown predicate {predicate!r}; {suggest(predicate, PREDICATES)}")
    objects = tuple(name.strip() for name in arguments.split(",")) if arguments.strip() else ()
    if len(objects) != PREDICATES[predicate] or not all(objects):
        raise ConfigError(f"{text.strip()!r}: expected {PREDICATES[predicate]} object(s), got {len(objects)}")
    return Term(predicate, objects)
