"""Sees changes at the moment from which a read gives them, inside the process that merges them."""

from __future__ import annotations

from collections.abc import Callable

from dsr import Edge, Memory, Node
from dsr.graph.watch import ChangeKind


def on_each_change(memory: Memory, seen: Callable[[Node | Edge, str | None], None]) -> None:
    """Call `seen(element, attribute)` for every change that the memory shows from then on.

    A watch tells its reader the same, but conflated and one change of threads later; a reader that looks by
    itself does not wait for that.
    """

    def offer(kind: ChangeKind, element: Node | Edge, *attributes: str) -> None:
        for attribute in attributes if kind == "updated" else (None, *attributes):
            seen(element, attribute)

    memory.watch(existing=False).offer = offer  # type: ignore[method-assign]
