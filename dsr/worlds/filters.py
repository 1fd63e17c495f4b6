"""Derives a world from others: a subclass of `Filter` says which elements are passed on, and how they change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dsr.graph.elements import Edge, Node
from dsr.worlds.clients import Client, WorldsConfig
from dsr.worlds.mirror import Conflict, Mirror


class FilterConfig(WorldsConfig, frozen=True, forbid_unknown_fields=True):
    """The worlds of a filter, and its rule for things that several of them hold."""

    conflict: Conflict = "newest"
    """Rule for things that several worlds hold.

    "newest": of each attribute the value written last; "first": the thing of the first listed world that has it.
    """


class Filter(Client):
    """Keeps the world `writes` in step with the worlds `reads`: all that it accepts, changed as `edit` says.

    An edge is passed on if it is accepted and both its ends are in the output. What is placed by a frame that is not
    passed on hangs on the nearest frame above that is, where it is in the input. A filter takes away only what it added
    itself, so several may write into one world, beside people and other agents. What somebody else takes away comes
    back as long as the input holds it. After a restart it goes on.

    Cascades may contain circles. Every value keeps the time at which it was first written and replaces only older ones,
    and no element is passed on to a world through which it came (attribute `via`); so every change passes each filter
    at most once.
    """

    Config = FilterConfig
    config: FilterConfig

    def accepts(self, node: Node) -> bool:
        """Whether a node is passed on; asked whenever it changes, or a mesh has come here.

        If it depends on more, see `refresh`.
        """
        return True

    def accepts_edge(self, edge: Edge) -> bool:
        """Whether an edge is passed on if its ends are."""
        return True

    def edit(self, element: Node | Edge, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Compute the attributes of an element in the output from those in the input."""
        return values

    def refresh(self) -> None:
        """Look at everything again in the next step: what is accepted has changed."""
        self._mirror.look_at_all()
        self.wake()

    def opened(self) -> None:
        """Begin to keep the output in step; who overrides this calls it too."""
        edit = None if type(self).edit is Filter.edit else self.edit
        conflict: Conflict = getattr(self.config, "conflict", "newest")
        self._mirror = Mirror(self.sources, self.target, self.accepts, self.accepts_edge, edit, conflict)
        self._mirror.look_at_all()
        self._meshes = self.memory.meshes.arrivals

    def update(self, now: float) -> None:
        """Pass on what has changed; who overrides this calls it too."""
        meshes = self.memory.meshes
        meshes.ask_again()
        if self._meshes != meshes.arrivals:
            self._meshes = meshes.arrivals
            self._mirror.look_at_all()
        self._mirror.update(self.changes())
