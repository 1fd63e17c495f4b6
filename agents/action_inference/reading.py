"""From the graph to an observation: things, how they are perceived and believed, and what was done with them."""

from __future__ import annotations

import logging

from agents.action_inference.observation import ObservedThing, Snapshot
from dsr.errors import SchemaError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.vocabulary.observed_actions import Deed, deeds_of
from dsr.vocabulary.relations import THINGS, is_present

log = logging.getLogger("action_inference.reading")


class SnapshotReader:
    """Observes a memory. Deeds that cannot be read are left out, which is logged once for each thing."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._unread: set[str] = set()

    def snapshot(self, now: float) -> Snapshot:
        """Read the snapshot of the memory at `now` (s)."""
        things = (self._thing(node, now) for node in self._memory.nodes(THINGS) if is_present(node))
        return Snapshot(now, {thing.name: thing for thing in things})

    def _thing(self, node: Node, now: float) -> ObservedThing:
        return ObservedThing(
            name=node.name,
            perceived=node.get("perceived") is True,
            plausible=node.get("plausible") is not False,
            is_placed=self._memory.get_edge(WORLD, node.name, "Virtual_RT") is not None,
            deeds=tuple(deed for deed in self._deeds(node) if deed.time <= now),
        )

    def _deeds(self, node: Node) -> tuple[Deed, ...]:
        try:
            deeds = deeds_of(node)
        except SchemaError as error:
            if node.name not in self._unread:
                log.warning("the deeds of %s are left out (logged once): %s", node.name, error)
            self._unread.add(node.name)
            return ()
        self._unread.discard(node.name)
        return deeds
