"""Passes a graph's visible changes on: to the tree of frames, the overlays of the graph and the watches over it."""

from __future__ import annotations

import weakref
from collections.abc import Iterable
from typing import Protocol

from dsr.frames.tree import FrameTree
from dsr.graph.elements import Edge, Node
from dsr.graph.watch import Watch
from dsr.math3d.transforms import Pose

_MOST_KINDS = 4096
"""Kinds of changes whose watches are remembered: more than any schema has"""


class LooksThrough(Protocol):
    """A graph that shows another one's elements, live; it is told what becomes of those."""

    def below_came(self, element: Node | Edge) -> None:
        """The other graph shows an element that it did not."""

    def below_went(self, element: Node | Edge) -> None:
        """The other graph does not show an element any more."""

    def below_changed(self, element: Node | Edge, attribute: str) -> None:
        """An attribute of an element of the other graph changed."""

    def below_has_others(self, element: Node | Edge) -> None:
        """Other incarnations of an element of the other graph are seen there now."""


class Watches:
    """The watches over one graph. Whoever is told of a pose by a watch finds it in the frames already.

    Args:
        geometric: edge types that carry a pose; may grow.
        frames: what is there to begin with; nothing if None.
    """

    def __init__(self, geometric: set[str] | None = None, frames: FrameTree | None = None) -> None:
        self.frames = frames or FrameTree()
        self._geometric = set() if geometric is None else geometric
        self._watches: list[Watch] = []
        self._wanting: dict[tuple[type, str, str | None], list[Watch]] = {}
        """Those that want a change, by the element's class and type and by the attribute, as far as it was asked for"""
        self._overlays: list[weakref.ref[LooksThrough]] = []  # which nobody keeps by this, and which keep the graph
        self._closed = False

    def follow(self, watch: Watch, existing: Iterable[Node | Edge]) -> None:
        """Tell `watch` of all changes from now on, and of elements that are there. The graph must be locked."""
        for element in existing:
            if watch.wants(element):
                watch.offer_all(element)
        self._wanting = {}
        self._watches = [other for other in self._watches if not other.closed] + [watch]

    def show_through(self, overlay: LooksThrough) -> None:
        """Tell `overlay` of all changes from now on, as long as somebody holds it. The graph must be locked."""
        self._overlays = [*self._overlays, weakref.ref(overlay)]

    def show_no_more(self, overlay: LooksThrough) -> None:
        """Tell `overlay` nothing any more. The graph must be locked."""
        self._overlays = [other for other in self._overlays if other() not in (None, overlay)]

    @property
    def overlays(self) -> list[LooksThrough]:
        """Graphs that look through to this one."""
        return [overlay for reference in self._overlays if (overlay := reference()) is not None]

    def tidy(self) -> None:
        """Forget overlays that are gone."""
        if any(overlay() is None for overlay in self._overlays):
            self._overlays = [overlay for overlay in self._overlays if overlay() is not None]

    def close(self) -> None:
        """End all watches."""
        self._closed = True
        for watch in self._watches:
            watch.close()

    def added(self, element: Node | Edge) -> None:
        """`element` became visible, with the attributes that it has."""
        if element.__class__ is not Node and isinstance(element, Edge):
            self.note_pose(element)
        if self._overlays:
            for overlay in self._told():
                overlay.below_came(element)
        if self._watches:
            for watch in self._who_want(element):
                watch.offer_all(element)

    def removed(self, element: Node | Edge) -> None:
        """`element` is not visible any more."""
        if isinstance(element, Edge) and element.type in self._geometric:
            self.frames.remove(element.type, element.src, element.dst)
        for overlay in self._told():
            overlay.below_went(element)
        for watch in self._who_want(element):
            watch.offer("removed", element)

    def updated(self, element: Node | Edge, attribute: str) -> None:
        """An attribute of `element` changed, appeared or went."""
        if attribute == "pose" and isinstance(element, Edge):
            self.note_pose(element)
        if self._overlays:
            for overlay in self._told():
                overlay.below_changed(element, attribute)
        if self._watches:
            found = self._wanting.get((element.__class__, element.type, attribute))
            for watch in self._who_want(element, attribute) if found is None else found:
                watch.offer("updated", element, attribute)

    def incarnations_changed(self, element: Node | Edge) -> None:
        """Other incarnations of `element` are seen now."""
        for overlay in self.overlays:
            overlay.below_has_others(element)

    def _who_want(self, element: Node | Edge, attribute: str | None = None) -> list[Watch]:
        """The watches that want such a change: of many watches, most want few."""
        key = element.__class__, element.type, attribute
        found = self._wanting.get(key)
        if found is None:
            if len(self._wanting) >= _MOST_KINDS:
                self._wanting = {}
            found = self._wanting[key] = [watch for watch in self._watches if watch.wants(element, attribute)]
        return found

    def _told(self) -> list[LooksThrough]:
        return self.overlays if self._overlays and not self._closed else []

    def note_pose(self, edge: Edge) -> None:
        """Let the frames follow the pose of `edge`, if it is geometric. The graph must be locked."""
        type = edge.type_name
        if type in self._geometric:
            pose = edge.get("pose")
            if isinstance(pose, Pose):
                self.frames.follow(type, edge.src, edge.dst, pose)
            else:
                self.frames.remove(type, edge.src, edge.dst)
