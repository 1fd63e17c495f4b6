"""Goals: conjunctions of relations, read from text such as `on(cube_3,cube_4) & on(cube_6,cube_5)`.

    goal     = relation { ("&" | "and") relation }
    relation = name [ "(" [ thing { "," thing } ] ")" ]

The relations are those of `vocabulary.relations.ARITY`. `on(a,table)` says on which table; `ontable(a)` leaves it open.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from dsr.errors import GoalError, suggest
from dsr.vocabulary.relations import ARITY, Relation, Relations

_TOKEN = re.compile(r"\s*(?:(?P<name>[A-Za-z0-9_.\-]+)|(?P<mark>[(),&])|(?P<other>\S))")
_EXAMPLE = "on(cube_3,cube_4) & clear(cube_3)"
_LONGEST_NAME = 128
_LONGEST = 10_000
"""Characters of a goal: hundreds of relations, for which no plan is found. A longer one takes its readers' time."""


@dataclass(frozen=True)
class Goal:
    """Relations that shall hold together."""

    relations: tuple[Relation, ...]
    text: str = field(default="", compare=False)
    """The goal's text as it was written."""
    places: tuple[tuple[str, int], ...] = field(default=(), compare=False)
    """Every name of a thing, with its column in the text."""

    def __str__(self) -> str:
        return " & ".join(map(str, self.relations))

    @property
    def things(self) -> tuple[str, ...]:
        """Names of all that it is about, each once, in the order in which they appear."""
        return tuple(dict.fromkeys(name for relation in self.relations for name in relation.arguments))

    def missing(self, relations: Relations) -> tuple[Relation, ...]:
        """List the relations of the goal that do not hold."""
        return tuple(relation for relation in self.relations if not relations.holds(relation))

    def holds(self, relations: Relations) -> bool:
        """Whether all of its relations hold."""
        return not self.missing(relations)

    def check_names(self, known: Iterable[str]) -> None:
        """Raise `GoalError`, pointing at it, for the first name that is not `known`."""
        names = set(known)
        for name, column in self.places:
            if name not in names:
                raise GoalError(self.text, column, f"there is no {name!r}; {suggest(name, names)}")


def parse_goal(text: str) -> Goal:
    """Read a goal from its text. Raises `GoalError`, which points at the fault."""
    if len(text) > _LONGEST:
        raise GoalError(text[:_LONGEST], 0, f"a goal may have at most {_LONGEST} characters, not {len(text)}")
    return _Parser(" ".join(text.splitlines()).expandtabs(1).rstrip()).goal()  # an end of spaces alone takes long


class _Token(NamedTuple):
    text: str
    column: int
    is_name: bool = False

    @property
    def is_and(self) -> bool:
        return self.text == "&" or (self.is_name and self.text.lower() == "and")


class _Parser:
    """One pass over one text."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = list(self._split())
        self._next = 0
        self._places: list[tuple[str, int]] = []

    def goal(self) -> Goal:
        relations = [self._relation()]
        while not self._at_end:
            joint = self._take()
            if not joint.is_and:
                raise self._error(joint, f"expected '&' or the end after {relations[-1]}, found {joint.text!r}")
            relations.append(self._relation())
        return Goal(tuple(dict.fromkeys(relations)), self._text, tuple(self._places))

    def _relation(self) -> Relation:
        token = self._take(f"expected a relation, such as {_EXAMPLE}")
        name = token.text.lower()
        if not token.is_name or token.is_and:
            raise self._error(token, f"expected a relation, found {token.text!r}; {suggest('', ARITY)}")
        if name in ("or", "not"):
            raise self._error(token, f"{name!r} is not possible: a goal is relations joined by '&', all of them wanted")
        if name not in ARITY:
            raise self._error(token, f"unknown relation {token.text!r}; {suggest(name, ARITY)}")
        things = self._things(name) if self._follows("(") else []
        if len(things) != ARITY[name]:
            count = f"{ARITY[name]} thing{'' if ARITY[name] == 1 else 's'}"
            raise self._error(token, f"{name} takes {count}, not {len(things)}; write {_usage(name)}")
        if len(things) == 2 and things[0].text == things[1].text:
            raise self._error(things[1], f"{things[1].text!r} cannot be on itself")
        self._places += [(thing.text, thing.column) for thing in things]
        return Relation(name, tuple(thing.text for thing in things))

    def _things(self, relation: str) -> list[_Token]:
        """What stands in parentheses."""
        self._take()
        things: list[_Token] = []
        if self._follows(")"):
            self._take()
            return things
        while True:
            thing = self._take(f"expected the name of a thing; write {_usage(relation)}")
            if not thing.is_name:
                found = f"expected the name of a thing, found {thing.text!r}"
                raise self._error(thing, f"{found}; write {_usage(relation)}")
            if len(thing.text) > _LONGEST_NAME:
                raise self._error(thing, f"a name may have at most {_LONGEST_NAME} characters, not {len(thing.text)}")
            things.append(thing)
            end = self._take(f"expected ',' or ')' after {thing.text!r}")
            if end.text == ")":
                return things
            if end.text != ",":
                raise self._error(end, f"expected ',' or ')' after {thing.text!r}, found {end.text!r}")

    def _split(self) -> Iterator[_Token]:
        for found in _TOKEN.finditer(self._text):
            kind = str(found.lastgroup)
            token = _Token(found[kind], found.start(kind), kind == "name")
            if kind == "other":
                joined = "; relations are joined by '&' or 'and'" if token.text in "|;+*/" else ""
                raise self._error(token, f"unexpected {token.text!r}{joined}")
            yield token

    @property
    def _at_end(self) -> bool:
        return self._next == len(self._tokens)

    def _follows(self, text: str) -> bool:
        return not self._at_end and self._tokens[self._next].text == text

    def _take(self, otherwise: str = "") -> _Token:
        if self._at_end:
            raise GoalError(self._text, len(self._text.rstrip()), otherwise)
        self._next += 1
        return self._tokens[self._next - 1]

    def _error(self, token: _Token, message: str) -> GoalError:
        return GoalError(self._text, token.column, message)


def _usage(relation: str) -> str:
    return {"on": "on(cube_3,cube_4)", "handempty": "handempty"}.get(relation, f"{relation}(cube_3)")
