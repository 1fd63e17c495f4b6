"""Replicas that have seen the same and hold something else: each time, a removal without its dot must be the reason."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from typing import NamedTuple
from unittest import mock

from benchmarks.years.world import World
from dsr.crdt.context import Dot
from dsr.crdt.store import Store
from dsr.replication.sync import Synchroniser

SAID = "a removal has come to"
"""How a replica begins to say so."""
LOGGER = "dsr.replication.sync"


class _Held(NamedTuple):
    """What a replica held when it said what it had seen."""

    rid: str
    fingerprint: int
    entries: dict[Dot, tuple[Dot, ...]]
    """Creation dots, with those of an edge's ends."""


class Differences(logging.Handler):
    """Looks at all replicas of the base whenever one of them says that it differs from what another one told.

    Args:
        world: what they are in.
    """

    def __init__(self, world: World) -> None:
        super().__init__()
        self.explained = 0
        """Pairs of replicas of which the difference had its reason."""
        self.unexplained: list[str] = []
        self._world = world
        self._told: dict[int, dict[str, _Held]] = {}

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """While inside, take down what replicas tell in their digests, and look when one says that it differs."""
        right = Synchroniser.digest

        def digest(synchroniser: Synchroniser, physical: float) -> bytes:
            store = synchroniser.graph.store
            if store in self._stores:
                told, rid = self._told.setdefault(store.context.hash, {}), synchroniser.graph.rid
                if rid not in told or told[rid].fingerprint != store.fingerprint:
                    told[rid] = _held(rid, store)
            return right(synchroniser, physical)

        logger = logging.getLogger(LOGGER)
        logger.addHandler(self)
        try:
            with mock.patch.object(Synchroniser, "digest", digest):
                yield
        finally:
            logger.removeHandler(self)

    @property
    def _stores(self) -> list[Store]:
        return [participant.memory.replica.graph.store for participant in self._world.participants]

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        if record.getMessage().startswith(SAID):
            for participant in self._world.participants:
                graph = participant.memory.replica.graph
                here = _held(graph.rid, graph.store)
                for there in self._told.get(graph.store.context.hash, {}).values():
                    if here.fingerprint != there.fingerprint:
                        self._explain(here, there, graph.store)

    def _explain(self, here: _Held, there: _Held, store: Store) -> None:
        removed: set[Dot] = set()
        for delta in self._world.committed:
            if any((rid, last) not in store.context for rid, _, last in delta.context):
                removed.update(delta.removed)
        ends = {**here.entries, **there.entries}
        for dot in here.entries.keys() ^ there.entries.keys():
            if removed.isdisjoint((dot, *ends[dot])):
                self.unexplained.append(f"{here.rid} and {there.rid} have seen the same, and only one holds {dot}")
                return
        self.explained += 1


def _held(rid: str, store: Store) -> _Held:
    return _Held(rid, store.fingerprint, {dot: (*e.sources, *e.destinations) for dot, e in store.entries.items()})
