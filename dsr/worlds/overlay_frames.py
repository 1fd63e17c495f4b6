"""The frames of an overlay: those of which it holds an edge of its own, all others live from its parent."""

from __future__ import annotations

from collections.abc import Sequence

from dsr.frames.frame_chain import Dependency, Link, Links, Newest
from dsr.frames.tree import FrameTree, Types
from dsr.math3d.transforms import Pose
from dsr.worlds.fork_frames import SharedHistories

_TAKEN = Link("", "", None)


class OverlayFrames(FrameTree):
    """Frames that look through to those of `source`, except for frames that were taken over."""

    def __init__(self, source: FrameTree) -> None:
        super().__init__(history=source._history, samples=source._samples, extrapolation=source._extrapolation)
        self._source = source
        self._taken: set[tuple[str, str]] = set()
        self._marks: dict[str, Links] = {}
        self._histories = SharedHistories(source, self._taken)
        source.show_through(self)

    def take_over(self, type: str, child: str) -> None:
        """Go on alone with the edges of this type to `child`, from where they are in the source."""
        if (type, child) in self._taken:
            return
        theirs, link = self._source.histories(type, child), self._source.link(type, child)
        if theirs is not None:
            self._histories[type, child] = theirs.copied()
        if link is not None:
            self._links(type)[child] = link
        self._taken.add((type, child))
        self._mark(type)[child] = _TAKEN

    def _mark(self, type: str) -> Links:
        return self._marks.setdefault(type, {})

    def update(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """See `FrameTree.update`; poses of frames that were not taken over are left to the parent."""
        if (type, child) in self._taken:
            super().update(type, parent, child, pose)

    def follow(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """See `FrameTree.follow`; frames that the overlay shows from its parent are left to the parent."""
        if (type, child) in self._taken:
            super().follow(type, parent, child, pose)

    def remove(self, type: str, parent: str, child: str) -> None:
        """See `FrameTree.remove`; frames that the overlay shows from its parent are left to the parent."""
        if (type, child) in self._taken:
            super().remove(type, parent, child)

    def types(self) -> set[str]:
        """See `FrameTree.types`."""
        return super().types() | self._source.types()

    def link(self, type: str, child: str) -> Link | None:
        """See `FrameTree.link`."""
        return self._links(type).get(child) if (type, child) in self._taken else self._source.link(type, child)

    def depend_on(self, type: str, child: str, link: Link | None) -> list[Dependency]:
        """See `FrameTree.depend_on`."""
        if (type, child) in self._taken:
            return [(self._links(type), child, link)]
        return [(self._mark(type), child, None), *self._source.depend_on(type, child, link)]

    def _newest_links(self, types: Types) -> Newest:
        return _LookThrough(types, self)


class _LookThrough(Newest):
    """Finds links here or in the source, and what both must not change."""

    def __init__(self, types: Sequence[str], frames: OverlayFrames) -> None:
        super().__init__(types, [])
        self._frames = frames

    def find(self, frame: str) -> Link | None:
        """The link of the first type that has one at this frame."""
        for type in self._types:
            link = self._frames.link(type, frame)
            if link is not None:
                return link
        return None

    def depend(self, frame: str, link: Link | None) -> list[Dependency]:
        """What must stay for `find` to answer with this link."""
        found: list[Dependency] = []
        for type in self._types:
            own = link if link is not None and type == link.type else None
            found += self._frames.depend_on(type, frame, own)
            if own is not None:
                break
        return found
