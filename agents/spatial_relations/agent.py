"""The agent that keeps edges of spatial relations up to date, as its configuration and requests in the graph want."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import msgspec

from dsr.agent import Access, Agent
from dsr.errors import ConfigError, DsrError, suggest
from dsr.graph.elements import Node
from dsr.graph.schema import is_name
from dsr.graph.shares import shared_out
from dsr.math3d.tolerance import PoseTolerance
from dsr.spatial import (
    EDGE_TYPES,
    EGOCENTRIC,
    QUERY,
    SOURCE,
    SPATIAL,
    WRITTEN,
    Box,
    Fact,
    Hysteresis,
    Scene,
    View,
    checked_relations,
    read_scene,
    read_view,
)
from dsr.spatial.scene import check_no_view
from dsr.timeline.entries import split_names
from dsr.vocabulary.relations import MODELLED, SURFACES, THINGS, nodes_by_name

_MOST_WISHES = 64
"""Requests that are answered at a time, as many of each agent as of the others: whoever asks could ask any number."""
_MOST_NAMES = 256
"""Things that one request names, on each side: of more all are meant."""
_MOST_TOLD = 4
"""Things that are told to be waited for, each with what may be meant."""


class Wish(NamedTuple):
    """Edges that somebody wants."""

    relations: tuple[str, ...]
    """Names of the wanted relations, some of `SPATIAL`."""
    things: frozenset[str] | None
    """Names of the sources; None for all things."""
    others: frozenset[str] | None
    """Names of the destinations; None for all."""
    viewpoint: str
    """Name of the frame; empty for none."""


def make_wish(relations: str, things: str, others: str, viewpoint: str) -> Wish:
    """Make a wish from these lists of names, comma-separated. Raises `ConfigError`."""
    names = checked_relations(_names(relations))
    if not names:
        raise ConfigError(f"no relation is named; some of {', '.join(SPATIAL)} are expected")
    if not viewpoint:
        check_no_view(names, "name a viewpoint")
    sources, destinations = (frozenset(_names(text)) or None for text in (things, others))
    if len(views := _names(viewpoint)) > 1:
        raise ConfigError(f"{len(views)} viewpoints; expected one, or none")
    return Wish(names, sources, destinations, views[0] if views else "")


def read_wish(node: Node) -> Wish:
    """The wish of a request. Raises `ConfigError`."""
    relations, things, others, viewpoint = (
        str(node.get(name, "")) for name in ("relations", "things", "others", "viewpoint")
    )
    return make_wish(relations, things, others, viewpoint)


def _names(text: str) -> tuple[str, ...]:
    """The names in a list. Raises `ConfigError` for what is no name, and for a list that is too long."""
    if text.count(",") >= _MOST_NAMES:
        raise ConfigError(f"{text.count(',') + 1} names; expected at most {_MOST_NAMES}, or none for all")
    for name in (names := split_names(text)):
        if not is_name(name):
            raise ConfigError(f"{name!r:.100} is no name")
    return names


Seen = tuple[Fact, str]
"""A relation, and the viewpoint from which it is so; empty for none."""
KEPT = "kept"
"""Status of an answered request; another status names a fault, or the things that are waited for."""
_STILL = PoseTolerance(5e-4, 2e-3)  # m, rad: what moved by less is where it was


class SpatialRelationsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The relations that are kept without a request, and how steadily."""

    relations: list[str] = []
    """Names of the relations that are kept without a request, some of `dsr.spatial.SPATIAL`; none: requests only."""
    things: list[str] = []
    """Sources; all things if empty."""
    others: list[str] = []
    """Destinations; all things if empty."""
    viewpoint: str = ""
    """Camera or frame from which `in_front_of`, `behind`, `left_of` and `right_of` are seen."""
    band: float = 0.01
    """m by which a relation must be over until its edge is removed"""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.band) and self.band >= 0.0):
            raise ValueError(f"band {self.band}: expected 0 or more")


class SpatialRelations(Agent):
    """Writes edges above, below, on_top, inside, next_to, close_to, in_front_of, ... while they are wanted.

    An edge has `since`, `source` "geometry" and, if it depends on who looks, `viewpoint`. There is one edge of a type
    between two things, so of requests for different viewpoints the first by name wins. After a restart it goes on from
    the edges that it finds.
    """

    name = "spatial_relations"
    rate_hz = 10.0
    shares_process = True
    reads = Access(
        nodes=(*THINGS, *SURFACES, *MODELLED, QUERY),
        edges=("RT", "Virtual_RT", *WRITTEN),
        attributes=(
            *("size", "bounds", "mesh", "present"),
            *("relations", "things", "others", "viewpoint", "source", "status"),
        ),
    )
    writes = Access(
        nodes=(QUERY,), edges=WRITTEN, attributes=("since", "source", "viewpoint", "status"), exclusive=WRITTEN
    )
    Config = SpatialRelationsConfig
    config: SpatialRelationsConfig

    def setup(self) -> None:
        """Read the configuration, and what an earlier run left.

        Raises `ConfigError` for names that are no relations.
        """
        config = self.config
        self._own: dict[str, Wish] = {}
        if config.relations:
            things, others = ",".join(config.things), ",".join(config.others)
            self._own[""] = make_wish(",".join(config.relations), things, others, config.viewpoint)
        self._hysteresis = Hysteresis[Seen](config.band, self._written())
        self._boxes: dict[str, Box] = {}
        self._margins: dict[Seen, float] = {}
        self._views: dict[str, View] = {}

    def tick(self, now: float) -> None:
        """Bring the edges into step with the scene."""
        wishes = dict(self._own)
        requests = nodes_by_name(self.memory, QUERY)
        problems = {node.name: f"{_MOST_WISHES} others are answered already" for node in requests}
        for node in shared_out(requests, _MOST_WISHES):
            del problems[node.name]
            try:
                wishes[node.name] = read_wish(node)
            except ConfigError as error:
                problems[node.name] = str(error)
        moved = self._look() if wishes else set()
        views = self._look_from(wishes, problems)
        wanted = self._wanted(wishes, views, problems)
        self._look_for(wishes, problems)
        self._margins = self._measured(wanted, views, moved)
        self._views = views
        with self.memory.batch():
            self._write(self._hysteresis.update(self._margins), now)
            self._answer(problems)

    def _look(self) -> set[str]:
        """Take in where things are; returns the names of those that moved."""
        boxes, moved = dict(read_scene(self.memory).boxes), set()
        for name, box in boxes.items():
            before = self._boxes.get(name)
            if before is not None and before.size == box.size and _STILL.covers(before.pose, box.pose):
                boxes[name] = before
            else:
                moved.add(name)
        self._boxes = boxes
        return moved

    def _look_from(self, wishes: Mapping[str, Wish], problems: dict[str, str]) -> dict[str, View]:
        views: dict[str, View] = {}
        for name, wish in wishes.items():
            if not wish.viewpoint or EGOCENTRIC.keys().isdisjoint(wish.relations) or wish.viewpoint in views:
                continue
            try:
                views[wish.viewpoint] = read_view(self.memory, wish.viewpoint)
            except DsrError as error:
                problems[name] = f"waits for its viewpoint: {error}"
        return views

    def _wanted(
        self, wishes: Mapping[str, Wish], views: Mapping[str, View], problems: dict[str, str]
    ) -> dict[Fact, str]:
        """The relations to look at, each with the viewpoint of the first who wants it."""
        wanted: dict[Fact, str] = {}
        for name, wish in wishes.items():
            for relation in wish.relations:
                viewpoint = wish.viewpoint if relation in EGOCENTRIC else ""
                if viewpoint and viewpoint not in views:
                    continue
                for source in self._boxes if wish.things is None else wish.things & self._boxes.keys():
                    for destination in self._boxes if wish.others is None else wish.others & self._boxes.keys():
                        fact = Fact(relation, source, destination)
                        if source != destination and wanted.setdefault(fact, viewpoint) != viewpoint:
                            problems[name] = f"{relation} is wanted as seen from {wanted[fact]} already"
        return wanted

    def _look_for(self, wishes: Mapping[str, Wish], problems: dict[str, str]) -> None:
        """Name who is wanted and not there, of wishes without another problem."""
        for name, wish in wishes.items():
            missing = {*(wish.things or ()), *(wish.others or ())} - self._boxes.keys()
            if missing:
                told = [self._missing(thing) for thing in sorted(missing)[:_MOST_TOLD]]
                more = f" and {len(missing) - _MOST_TOLD} more" if len(missing) > _MOST_TOLD else ""
                problems.setdefault(name, f"waits for {', '.join(told)}{more}")

    def _missing(self, name: str) -> str:
        why = "no thing that is somewhere, with a size" if name in self.memory else suggest(name, self._boxes)
        return f"{name!r} ({why})"

    def _measured(self, wanted: Mapping[Fact, str], views: Mapping[str, View], moved: set[str]) -> dict[Seen, float]:
        """Margins; those between things that did not move are taken over."""
        turned = {name for name, view in views.items() if self._views.get(name) != view}
        scene, margins = Scene(self._boxes), {}
        for fact, viewpoint in wanted.items():
            known = self._margins.get((fact, viewpoint))
            if known is None or viewpoint in turned or fact.source in moved or fact.destination in moved:
                known = scene.margin(fact, views.get(viewpoint))
            margins[fact, viewpoint] = known
        return margins

    def _write(self, holding: frozenset[Seen], now: float) -> None:
        written = self._written()
        for fact, _ in sorted(written - holding):
            self.memory.remove_edge(fact.source, fact.destination, EDGE_TYPES[fact.relation])
        for fact, viewpoint in sorted(holding - written):
            seen = {"viewpoint": viewpoint} if viewpoint else {}
            kind = EDGE_TYPES[fact.relation]
            self.memory.add_edge(fact.source, fact.destination, kind, since=now, source=SOURCE, **seen)

    def _written(self) -> frozenset[Seen]:
        """The edges that are there."""
        return frozenset(
            (Fact(relation, edge.src, edge.dst), str(edge.get("viewpoint", "")))
            for relation, kind in EDGE_TYPES.items()
            for edge in self.memory.edges(kind)
        )

    def _answer(self, problems: Mapping[str, str]) -> None:
        """Say of each request how it goes."""
        for node in self.memory.nodes(QUERY):
            status = problems.get(node.name, KEPT)
            if node.get("status") != status:
                self.memory.update_node(node.name, status=status)
        self.degraded = problems.get("", "")
