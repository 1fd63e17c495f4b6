"""Sentences about a connection for people: few, however many nodes there are to be told of."""

from __future__ import annotations

from collections.abc import Iterable

_MOST = 20
"""Sentences of one kind: more is not read, and names are made up by whoever announces them"""


def few(sentences: Iterable[str]) -> list[str]:
    """The first ones in the order of the alphabet, each once, and how many more there are."""
    found = sorted(set(sentences))
    more = len(found) - _MOST
    return [*found[:_MOST], f"and {more} more of this kind"] if more > 0 else found
