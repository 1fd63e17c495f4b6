"""What a graph tells of its changes."""

from __future__ import annotations

from typing import Protocol

from dsr.graph.elements import Edge, Node


class Listener(Protocol):
    """Told about every visible change, local or remote."""

    def added(self, element: Node | Edge) -> None:
        """`element` became visible, with the attributes that it has."""

    def removed(self, element: Node | Edge) -> None:
        """`element` is not visible any more."""

    def updated(self, element: Node | Edge, attribute: str) -> None:
        """An attribute changed, appeared or went."""


class NoListener:
    """For a graph that nobody follows."""

    def added(self, element: Node | Edge) -> None:
        """See `Listener`."""

    def removed(self, element: Node | Edge) -> None:
        """See `Listener`."""

    def updated(self, element: Node | Edge, attribute: str) -> None:
        """See `Listener`."""
