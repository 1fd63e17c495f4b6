"""The frames of a fork: those that it or its parent has changed since, and below them, unchanged, the parent's."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from dsr.frames.frame_chain import Link, Links, Newest
from dsr.frames.parents import Parents
from dsr.frames.tree import FrameTree, Types
from dsr.math3d.transforms import Pose

_Key = tuple[str, str]
"""(edge type, child)"""


class ForkedFrames(FrameTree):
    """Frames that begin as those of `source` at this moment, recent past included.

    As in the fork's graph, the source has its forks take over what it is about to change. What is read is kept in the
    table of links, so that chains depend on one table only and cost what they cost in any tree.

    Args:
        source: the parent's frames; nothing may change them while the fork is made.
    """

    def __init__(self, source: FrameTree) -> None:
        super().__init__(history=source._history, samples=source._samples, extrapolation=source._extrapolation)
        self._source = source
        self._taken: set[_Key] = set()
        self._histories = SharedHistories(source, self._taken)
        self._owned = set()
        self._changing = threading.RLock()
        """Held while a link is changed, or one of the source is put into the table."""
        source.share_with(self)

    def take_over(self, type: str, child: str) -> None:
        """Keep the edges of this type to `child` as they are in the source, whatever happens there."""
        with self._changing:
            if (type, child) in self._taken:
                return
            histories, link = self._source.histories(type, child), self._source.link(type, child)
            if histories is not None:
                self._histories[type, child] = histories
            if link is not None:
                self._links(type)[child] = link
            self._taken.add((type, child))

    def update(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """See `FrameTree.update`."""
        with self._changing:
            super().update(type, parent, child, pose)

    def follow(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """See `FrameTree.follow`."""
        with self._changing:
            super().follow(type, parent, child, pose)

    def remove(self, type: str, parent: str, child: str) -> None:
        """See `FrameTree.remove`."""
        with self._changing:
            super().remove(type, parent, child)

    def _before_change(self, type: str, child: str) -> None:
        self.take_over(type, child)
        super()._before_change(type, child)

    def types(self) -> set[str]:
        """See `FrameTree.types`."""
        return super().types() | self._source.types()

    def link(self, type: str, child: str) -> Link | None:
        """See `FrameTree.link`."""
        links = self._links(type)
        link = links.get(child)
        if link is not None or (type, child) in self._taken:
            return link
        found = self._source.link(type, child)
        with self._changing:
            if (type, child) in self._taken or found is None:
                return links.get(child)
            return links.setdefault(child, found)

    def _newest_links(self, types: Types) -> Newest:
        return _ReadThrough(types, [self._links(type) for type in types], self.link)


class _ReadThrough(Newest):
    """Finds links also where they are not yet in the tables."""

    def __init__(self, types: Sequence[str], tables: Sequence[Links], link: Callable[[str, str], Link | None]) -> None:
        super().__init__(types, tables)
        self._link = link

    def find(self, frame: str) -> Link | None:
        """The link of the first type that has one at this frame."""
        for type in self._types:
            link = self._link(type, frame)
            if link is not None:
                return link
        return None


class SharedHistories(dict[_Key, Parents]):
    """Histories by (type, child): those taken over, and below them the source's."""

    def __init__(self, source: FrameTree, taken: set[_Key]) -> None:
        super().__init__()
        self._source = source
        self._taken = taken

    def get(self, key: _Key, default: Parents | None = None) -> Parents | None:  # type: ignore[override]
        """See `dict`."""
        found = super().get(key)
        if found is None and key not in self._taken:
            theirs = self._source.histories(*key)
            if key not in self._taken:
                return default if theirs is None else theirs
            found = super().get(key)
        return default if found is None else found

    def copy(self) -> dict[_Key, Parents]:
        """Copy all histories into an ordinary dictionary."""
        theirs = self._source._histories.copy()
        return {key: histories for key, histories in theirs.items() if key not in self._taken} | dict(self)
