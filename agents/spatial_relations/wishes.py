"""What is wanted: which relations between which things, seen from where."""

from __future__ import annotations

from typing import NamedTuple

from dsr.errors import ConfigError
from dsr.graph.elements import Node
from dsr.spatial import SPATIAL, checked_relations
from dsr.spatial.scene import check_no_view
from dsr.timeline.entries import split_names


class Wish(NamedTuple):
    """Edges that somebody wants."""

    relations: tuple[str, ...]
    """Some of `SPATIAL`."""
    things: frozenset[str] | None
    """Names of the sources; None for all things."""
    others: frozenset[str] | None
    """Names of the destinations, likewise."""
    viewpoint: str
    """Name of the frame; empty for none."""


def make_wish(relations: str, things: str, others: str, viewpoint: str) -> Wish:
    """The wish that these lists of names, comma-separated, amount to. Raises `ConfigError`."""
    names = checked_relations(split_names(relations))
    if not names:
        raise ConfigError(f"no relation is named; some of {', '.join(SPATIAL)} are expected")
    if not viewpoint:
        check_no_view(names, "name a viewpoint")
    return Wish(names, _names(things), _names(others), viewpoint)


def read_wish(node: Node) -> Wish:
    """The wish of a request. Raises `ConfigError`."""
    relations, things, others, viewpoint = (
        str(node.get(name, "")) for name in ("relations", "things", "others", "viewpoint")
    )
    return make_wish(relations, things, others, viewpoint)


def _names(text: str) -> frozenset[str] | None:
    return frozenset(split_names(text)) or None
