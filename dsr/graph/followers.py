"""What follows a graph's changes as they happen: the tree of frames and the watches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from dsr.frames.tree import FrameTree
from dsr.graph.elements import Edge, Node
from dsr.graph.watch import ChangeKind
from dsr.math3d.transforms import Pose


class Follower(Protocol):
    """Told about changes: a `Watch`, or an overlay of the graph."""

    @property
    def closed(self) -> bool:
        """Whether it wants to hear no more."""

    def offer(self, kind: ChangeKind, element: Node | Edge, attribute: str | None = None) -> None:
        """An element changed or went."""

    def offer_all(self, element: Node | Edge) -> None:
        """An element came, with all its attributes."""

    def close(self) -> None:
        """Nothing will change any more."""


class Followers:
    """The listener of one graph. Whoever is told of a pose by a watch finds it in the frames already.

    Args:
        geometric: edge types that carry a pose; may grow.
        frames: what is there to begin with; nothing if None.
    """

    def __init__(self, geometric: set[str], frames: FrameTree | None = None) -> None:
        self.frames = frames or FrameTree()
        self._geometric = geometric
        self._watches: list[Follower] = []

    def follow(self, watch: Follower, existing: Iterable[Node | Edge]) -> None:
        """Tell `watch` of all changes from now on, and of elements that are there. The graph must be locked."""
        for element in existing:
            watch.offer_all(element)
        self._watches = [other for other in self._watches if not other.closed] + [watch]

    def close(self) -> None:
        """End all watches."""
        for watch in self._watches:
            watch.close()

    def added(self, element: Node | Edge) -> None:
        """Part of `dsr.graph.listener.Listener`."""
        if isinstance(element, Edge):
            self._note_pose(element)
        for watch in self._watches:
            watch.offer_all(element)

    def removed(self, element: Node | Edge) -> None:
        """Part of `dsr.graph.listener.Listener`."""
        if isinstance(element, Edge) and element.type in self._geometric:
            self.frames.remove(element.type, element.src, element.dst)
        for watch in self._watches:
            watch.offer("removed", element)

    def updated(self, element: Node | Edge, attribute: str) -> None:
        """Part of `dsr.graph.listener.Listener`."""
        if attribute == "pose" and isinstance(element, Edge):
            self._note_pose(element)
        for watch in self._watches:
            watch.offer("updated", element, attribute)

    def _note_pose(self, edge: Edge) -> None:
        type = edge.type_name
        if type in self._geometric:
            pose = edge.get("pose")
            if isinstance(pose, Pose):
                self.frames.follow(type, edge.src, edge.dst, pose)
            else:
                self.frames.remove(type, edge.src, edge.dst)
