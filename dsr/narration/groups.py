"""Answers a question about several things, `any of the cubes` or `cube_3 and cube_5`, from the answers about each."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from dsr.errors import ConfigError
from dsr.narration.answer import Response, joined, understood
from dsr.narration.naming import UnknownNameError, members_called, node_of
from dsr.narration.questions import Query
from dsr.narration.statements import Moment
from dsr.vocabulary.sentences import listed

_MOST = 12
"""Things that one question is answered for: more no person listens to"""
_OF_SEVERAL = frozenset({
    "count", "which", "which_state", "any_state", "which_did", "last_done", "what_unseen", "closest",
    "extreme", "which_on", "any_on",
})  # fmt: skip
"""Kinds of questions whose first thing may be words for several: those answer for all that fit."""
_FIRST_MAY_BE_KIND = frozenset({"any_so", "contents", "where_in"})
"""Kinds whose first of two things is a kind of things."""


class Several(msgspec.Struct, frozen=True):
    """The things that a part of a question means."""

    index: int
    """Of the part among the things of the query."""
    names: tuple[str, ...]
    is_any: bool
    """Whether a yes for one of them is a yes; else all must be so."""


def several_in(moment: Moment, query: Query) -> Several | None:
    """The first part of a question that means several things; None if each means one.

    Words that fit several things (`the camera`) mean any of them where the question is one of yes or no.

    Raises:
        UnknownNameError: for words that nothing fits.
        ConfigError: if they fit too many.
    """
    for index, asked in enumerate(query.things):
        if index == 0 and _may_be_kind(query):
            continue
        found = _members(moment, asked)
        if found is None:
            continue
        names, is_any = found
        if not names:
            raise UnknownNameError(asked, f"nothing is called {asked!r}")
        if len(names) > _MOST:
            raise ConfigError(f"{asked!r} may be {len(names)} things: name at most {_MOST}")
        return Several(index, names, is_any)
    return None


def _may_be_kind(query: Query) -> bool:
    """Whether the first part of a question may be a kind of things, of which the answer itself tells all."""
    if query.kind == "is_there":
        return query.word == "there"
    return query.kind in _OF_SEVERAL or (query.kind in _FIRST_MAY_BE_KIND and len(query.things) > 1)


def answer_of_each(query: Query, several: Several, answer: Callable[[Query], Response]) -> Response:
    """Answer a question for each of several things, and put the answers together."""
    found: dict[str, Response] = {}
    for name in several.names:
        things = list(query.things)
        things[several.index] = name.lower()
        found[name] = answer(msgspec.structs.replace(query, things=tuple(things)))
    verdicts = {name: one.verdict for name, one in found.items() if one.verdict is not None}
    told = list({one.text: one for response in found.values() for one in response.evidence}.values())
    if not verdicts:
        names = dict.fromkeys(name for one in found.values() for name in one.names)
        return understood(" ".join(one.text for one in found.values()), told, names=names)
    so = [name for name, holds in verdicts.items() if holds]
    holds = bool(so) if several.is_any else len(so) == len(verdicts)
    told_of = so if several.is_any and so else list(verdicts)
    told = list({one.text: one for name in told_of for one in found[name].evidence}.values())
    of = f"that is so of {listed(so)}" if so else f"that is so of none of {listed(list(verdicts))}"
    rest = [name for name in verdicts if name not in so]
    others = f", and not of {listed(rest)}" if so and rest else ""
    text = f"{'Yes' if holds else 'No'}: {of}{others}. {joined(told)}".strip()
    return understood(text, told, verdict=holds, names=so)


def _members(moment: Moment, asked: str) -> tuple[tuple[str, ...], bool] | None:
    """Names of the things that words mean, and whether any of them counts; None for words that mean one."""
    parts = asked.split(" and ")
    if len(parts) > 1:
        return tuple(dict.fromkeys(node_of(moment, part).name for part in parts)), False
    quantifier, _, words = asked.partition(" ")
    if words and quantifier in ("any", "all"):
        return tuple(node.name for node in members_called(moment, words)), quantifier == "any"
    return None


def ambiguous_in(error: UnknownNameError, query: Query) -> Several | None:
    """The things that ambiguous words may mean, for a question of yes or no; None if nothing fits or too many do."""
    if not 1 < len(error.candidates) <= _MOST or error.asked not in query.things:
        return None
    return Several(query.things.index(error.asked), error.candidates, is_any=True)
