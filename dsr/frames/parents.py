"""The edges of one type to a frame, by parent, and which of them has the newest sample."""

from __future__ import annotations

from heapq import heapify, heappop, heappush

from dsr.frames.pose_history import PoseHistory


class Parents(dict[str, PoseHistory]):
    """The samples of each edge. One thread may change them while others read copies of the table.

    Somebody may hang a frame from thousands of others. So parents are ranked in a heap, and no change looks at all.
    """

    __slots__ = ("_ranked",)

    def __init__(self) -> None:
        super().__init__()
        self._ranked: list[tuple[float, str]] | None = None
        """At least each parent with the stamp of its newest sample, negative; others are out of date."""

    def copied(self) -> Parents:
        """Make an independent copy, samples included; `copy` makes one of the table alone, at one moment."""
        other = Parents()
        for parent, history in self.items():
            other[parent] = history.copy()
        return other

    def note(self, parent: str) -> None:
        """Note that an edge is new, or has another newest sample."""
        if self._ranked is not None:
            heappush(self._ranked, (-self[parent].newest.stamp, parent))

    def newest(self) -> str:
        """The parent with the newest sample; ties go by name. There must be one."""
        if len(self) == 1:
            self._ranked = None
            return next(iter(self))
        if self._ranked is None or len(self._ranked) > 2 * len(self):
            self._ranked = [(-history.newest.stamp, parent) for parent, history in self.items()]
            heapify(self._ranked)
        while True:
            stamp, parent = self._ranked[0]
            if parent in self and self[parent].newest.stamp == -stamp:
                return parent
            heappop(self._ranked)
