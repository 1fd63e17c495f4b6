"""Texts in attributes that would take their readers hours, or end them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.believing.distribution import decoded
from dsr.errors import GoalError
from dsr.graph.elements import Node
from dsr.graph.schema import MAX_LENGTH
from dsr.security.policy import Grant
from dsr.vocabulary.explained import changes_of
from dsr.vocabulary.goals import parse_goal

_PATIENCE = 30.0
"""s until a megabyte has arrived"""
_MOST_SECONDS = 5.0
"""CPU seconds that reading one text may take"""
_NODE = "told"
_GRANTS = {"victim": Grant(("*",), ("*",), ("*",), trusted=True), "liar": Grant(("event",), (), ("note",))}


def _reading(text: str, read: Callable[[Node], object]) -> Callable[[Arena], Outcome]:
    def run(arena: Arena) -> Outcome:
        victim, liar = arena.join("victim"), arena.join("liar")
        liar.add_node(_NODE, "event", note=text)
        came = arena.eventually(lambda: _NODE in victim and "note" in victim.node(_NODE), _PATIENCE)
        begin = time.process_time()
        failed = ""
        try:
            read(victim.node(_NODE))
        except (RecursionError, ValueError) as error:
            failed = f", {type(error).__name__}"
        took = time.process_time() - begin
        held = came and not failed and took < _MOST_SECONDS
        return Outcome(held, f"{len(text)} characters read in {took:.2f} s{failed}", {"seconds": took})

    return run


def _goal(node: Node) -> None:
    with contextlib.suppress(GoalError):
        parse_goal(node["note"])


ATTACKS = [
    Attack(
        "text-goal",
        "wants a goal that ends with a million spaces",
        "it is read or refused at once",
        _reading("on(a,b)" + " " * (MAX_LENGTH - 7), _goal),
        _GRANTS,
    ),
    Attack(
        "text-explanation",
        "tells an explanation of one word of a million letters",
        "it is read at once",
        _reading("a" * MAX_LENGTH, lambda node: changes_of({}, node["note"])),
        _GRANTS,
    ),
    Attack(
        "text-nested",
        "tells where a thing may be by ten thousand lists inside each other",
        "its reader goes on without it",
        _reading('{"x": ' + "[" * 10_000, lambda node: decoded("cube", node["note"], None)),
        _GRANTS,
    ),
]
