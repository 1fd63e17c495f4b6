"""The perspective filter: keeps a world for each person, with the things that they see and remember."""

from __future__ import annotations

import contextlib
from collections import Counter
from typing import Annotated

import msgspec

from agents.perspectives.view import KINDS, LOOKS, RELATIONS, PersonalView
from dsr.agent import Access, Agent
from dsr.errors import DsrError, suggest
from dsr.graph.access import EVERYTHING
from dsr.graph.schema import WORLD_RECORD
from dsr.graph.shares import makers, shared_out
from dsr.memory import Memory
from dsr.network.keys import BASE, check_name
from dsr.timeline import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES
from dsr.visibility import BAND, LEAST_SHARE, PERSON, PERSPECTIVES, WIDTH, VisibilityMonitor
from dsr.vocabulary.perceived import MOST_PERSONS, seconds_unseen
from dsr.vocabulary.relations import SURFACES

PREFIX = "view_of_"
"""Prefix of a person's name in the name of the person's world."""
_TOLD = (*LOOKS, "perceived", "present", "last_seen", "seen_at", "fov", "source", "share", "visible")
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class PerspectivesConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The persons whose worlds are kept, and the limits of visibility."""

    of: tuple[str, ...] = ()
    """Names of persons and cameras, which may come later; all persons that come if empty."""
    world: str = BASE
    """Name of the world that the persons see."""
    least_share: Share = LEAST_SHARE
    """Least share of a thing's pixels, as it would have alone, from which on it is visible."""
    band: Share = BAND
    """Hysteresis: a visible thing stays visible until its share is below the least by this much."""
    empty_share: Share = 0.5
    """Share of a thing's image at its old place from which that place is seen to be empty."""
    patience: Annotated[float, msgspec.Meta(ge=0)] = 0.3
    """s for which a place must be empty"""
    width: Annotated[int, msgspec.Meta(ge=16, le=4096)] = WIDTH
    """px, of the pictures"""

    def __post_init__(self) -> None:
        for name in self.of:
            check_name("world name", f"{PREFIX}{name}")


class Perspectives(Agent):
    """Keeps worlds `view_of_<person>`, one for each person that comes: see `PersonalView` for their content.

    A world stays when the person leaves, unless too many others come; after a restart of the agent it goes on, if
    somebody else holds it.
    """

    name = "perspectives"
    rate_hz = 5.0
    reads = Access(
        nodes=("*",),
        edges=("RT", "Virtual_RT", *RELATIONS),
        attributes=(*LOOKS, "perceived", "present", "last_seen", "fov"),
    )
    writes = Access(
        nodes=(WORLD_RECORD, "world", *KINDS, *SURFACES, *PERSPECTIVES, *WRITTEN_NODES),
        edges=("RT", "sees", *RELATIONS, *WRITTEN_EDGES),
        attributes=(*_TOLD, *WRITTEN_ATTRIBUTES),
        worlds=(f"{PREFIX}{EVERYTHING}",),
    )
    Config = PerspectivesConfig
    config: PerspectivesConfig

    def setup(self) -> None:
        """Begin without any world."""
        self._views: dict[str, PersonalView] = {}
        self._monitor: VisibilityMonitor | None = None
        self._source: Memory | None = None
        self._warned: set[str] = set()
        self._names_now: list[str] = []
        self._made_by: dict[str, frozenset[str]] = {}
        """Agents that made the nodes of those whose worlds are kept."""

    def tick(self, now: float) -> None:
        """Look with everybody's eyes."""
        source = self._open()
        if source is None or self._monitor is None:
            return
        self._monitor.update()
        self.degraded = ""
        names = self._names_now = self._names(source)
        views = [view for name in names if (view := self._view(name, source)) is not None]
        removed = [view for name, view in sorted(self._views.items()) if name not in names and not view.world.closed]
        for view in (*views, *removed):
            view.update(self._monitor, now)

    def _open(self) -> Memory | None:
        """The world that they see; None while there is none."""
        if self._source is None or self._source.closed:
            config = self.config
            try:
                self._source = self.memory.world(config.world)
            except DsrError as error:
                self.degraded = str(error)
                return None
            self._monitor = VisibilityMonitor(
                self._source, config.of or None, least_share=config.least_share, band=config.band, width=config.width,
                kinds=PERSPECTIVES if config.of else (PERSON,),
            )  # fmt: skip
            self._views.clear()
            self._made_by.clear()
        return self._source

    def _names(self, source: Memory) -> list[str]:
        """Whose worlds are kept now."""
        if not self.config.of:
            now = source.clock.now()
            lately = sorted(source.nodes(PERSON), key=lambda node: (seconds_unseen(node, now), node.name))
            return sorted(node.name for node in shared_out(lately, MOST_PERSONS))
        known = sorted(node.name for node in source.nodes(PERSPECTIVES))
        for name in self.config.of:
            if name not in known and name not in self._views:
                self._warn(name, source, known)
        return [name for name in self.config.of if name in known]

    def _warn(self, name: str, source: Memory, known: list[str]) -> None:
        """Say once of each name that it is nobody's who sees; they may come later."""
        if name in self._warned:
            return
        self._warned.add(name)
        node = source.get_node(name)
        kind = "is not there" if node is None else f"is of type {node.type}"
        self.log.warning("%r %s: no camera or person; %s", name, kind, suggest(name, known))

    def _view(self, name: str, source: Memory) -> PersonalView | None:
        view = self._views.get(name)
        if view is None or view.world.closed:
            config, made_by = self.config, makers(source.node(name))
            self._make_room()
            try:
                world = self.memory.create_world(f"{PREFIX}{name}", exist_ok=True)
            except DsrError as error:
                self.degraded = "; ".join(filter(None, (self.degraded, str(error))))
                return None
            self._views[name] = view = PersonalView(
                name, source, world, empty_share=config.empty_share, patience=config.patience
            )
            self._made_by[name] = made_by
        return view

    def _make_room(self) -> None:
        """Delete the world of somebody who is gone, if there are as many as persons: of whose agent there are most."""
        while len(self._views) >= MOST_PERSONS and (gone := self._views.keys() - self._names_now):
            counts = Counter(maker for makers in self._made_by.values() for maker in makers)
            oldest = [name for name in self._views if name in gone]
            name = max(oldest, key=lambda name: min(counts[maker] for maker in self._made_by[name]))
            del self._views[name], self._made_by[name]
            with contextlib.suppress(DsrError):
                self.memory.delete_world(f"{PREFIX}{name}")
