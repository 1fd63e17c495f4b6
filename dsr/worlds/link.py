"""How an overlay hears of its parent without keeping it, or being kept by it."""

from __future__ import annotations

import weakref
from typing import Protocol

from dsr.graph.elements import Edge, Node
from dsr.graph.watch import ChangeKind


class LooksThrough(Protocol):
    """What an overlay is told."""

    def below_came(self, element: Node | Edge) -> None:
        """The parent shows an element that it did not."""

    def below_went(self, element: Node | Edge) -> None:
        """The parent does not show an element any more."""

    def below_changed(self, element: Node | Edge, attribute: str) -> None:
        """An attribute of an element of the parent changed."""


class Link:
    """Follows the parent of an overlay, as long as somebody holds that."""

    def __init__(self, overlay: LooksThrough) -> None:
        self._overlay = weakref.ref(overlay)
        self._closed = False

    @property
    def closed(self) -> bool:
        """See `Follower`."""
        return self._closed or self._overlay() is None

    def offer(self, kind: ChangeKind, element: Node | Edge, attribute: str | None = None) -> None:
        """See `Follower`."""
        overlay = self._overlay()
        if overlay is None or self._closed:
            return
        if kind == "removed":
            overlay.below_went(element)
        elif attribute is not None:
            overlay.below_changed(element, attribute)

    def offer_all(self, element: Node | Edge) -> None:
        """See `Follower`."""
        overlay = self._overlay()
        if overlay is not None and not self._closed:
            overlay.below_came(element)

    def close(self) -> None:
        """See `Follower`."""
        self._closed = True
