"""Where is one frame, seen from another: chains of geometric edges, over time.

A frame's chain follows its incoming edges upwards: at each frame the first edge type of `types` that has
one, and among several parents of that type (two cameras see one cube) the one with the newest sample.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from itertools import takewhile

import msgspec

from dsr.errors import ExtrapolationError, NoPathError, TransformError, suggest
from dsr.pose_history import PoseHistory
from dsr.transforms import Pose

Types = tuple[str, ...]

_MOST_CACHED = 4096


class _Link(msgspec.Struct, frozen=True, gc=False):
    """The edge that a chain takes upwards from a frame; `pose` is parent_from_frame, None if unknown then."""

    type: str
    parent: str
    pose: Pose | None


_Links = dict[str, _Link]
_Chain = dict[str, _Link | None]
"""Frames from the bottom up, each with the link to the next."""
_Steps = list[tuple[str, _Link]]
"""The part of a chain that a transform is made of."""
_Dependency = tuple[_Links, str, _Link | None]
"""A result holds while the table has this link at this frame."""


class FrameTree:
    """The geometric edges of a graph with their recent past, asked for transforms between any two frames.

    Any number of threads may call `transform` while one at a time calls `update` and `remove`, without a
    lock: every table entry that a reader uses is an immutable value, replaced as a whole. A result is made
    of one consistent value per edge; edges that change meanwhile are seen by the next call.

    Args:
        history: s, how far back the samples of an edge are kept.
        samples: how many samples of an edge are kept at most.
        extrapolation: s, how long after its newest sample an edge may be asked; it is held constant.
    """

    def __init__(self, *, history: float = 10.0, samples: int = 512, extrapolation: float = 0.1) -> None:
        self._history = history
        self._samples = samples
        self._extrapolation = extrapolation
        self._histories: dict[tuple[str, str], dict[str, PoseHistory]] = {}  # (type, child) -> by parent
        self._newest: dict[str, _Links] = {}  # type -> child -> link to the parent with the newest sample
        self._cache: dict[tuple[str, str, Types], tuple[list[_Dependency], Pose]] = {}

    def update(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """Record the sample parent_from_child of an edge; it need not be the newest.

        The stamp 0.0 means "always". A sample equal to the one of its stamp changes nothing.
        """
        histories = self._histories.get((type, child), {})
        if parent in histories:
            histories[parent].add(pose)
        else:
            history = PoseHistory(pose, self._history, self._samples)
            self._histories[type, child] = {**histories, parent: history}
        self._choose_newest(type, child)

    def follow(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """Let `pose` be the newest sample of an edge: those of later stamps lost against it, and are forgotten.

        What a graph shows is the write that won, whatever its stamp; so all replicas have the same transforms.
        """
        history = self._histories.get((type, child), {}).get(parent)
        if history is None or pose.stamp >= history.newest.stamp:
            self.update(type, parent, child, pose)
        else:
            history.end_with(pose)
            self._choose_newest(type, child)

    def remove(self, type: str, parent: str, child: str) -> None:
        """Forget an edge and its past; harmless if there is none."""
        histories = self._histories.get((type, child), {})
        self._histories[type, child] = {name: h for name, h in histories.items() if name != parent}
        self._choose_newest(type, child)

    def _choose_newest(self, type: str, child: str) -> None:
        """Let the table name the newest of the frame's edges; a link that is still right stays the same."""
        links = self._newest.setdefault(type, {})
        histories = self._histories[type, child]
        if not histories:
            del self._histories[type, child]
            links.pop(child, None)
            return
        parent, history = _by_newest(histories)[0]
        link, pose = links.get(child), history.newest
        if link is None or link.pose is not pose or link.parent != parent:
            links[child] = _Link(type, parent, pose)

    def transform(self, target: str, source: str, at: float | None = None, types: Types = ("RT",)) -> Pose:
        """target_from_source: where the frame `source` is in the frame `target`.

        Args:
            target: the frame to express it in.
            source: the frame asked for.
            at: s, the time asked for; None takes the newest sample of each edge. An edge with one sample,
                or of stamp 0.0, holds at all times; of several parents, those known at that time precede.
            types: edge types in the order of preference; ("Virtual_RT", "RT") is belief first.

        Returns:
            The pose with the stamp `at`, or else the oldest stamp on the chain (0.0 if all of it is static).

        Raises:
            NoPathError: if the two chains do not meet.
            ExtrapolationError: if an edge on the way is not known at that time.
            TransformError: if they do not meet because edges form a cycle.
        """
        if at is not None:
            up, down = self._path(target, source, types, lambda frame: self._link_at(frame, at, types))
            return self._product(up, down, at).with_stamp(at)
        cached = self._cache.get((target, source, types))
        if cached is None:
            return self._newest_transform(target, source, types)
        for links, frame, link in cached[0]:
            if links.get(frame) is not link:
                return self._newest_transform(target, source, types)
        return cached[1]

    def _newest_transform(self, target: str, source: str, types: Types) -> Pose:
        """The transform by the newest samples, kept together with the table entries it was made of."""
        tables = [self._newest.setdefault(type, {}) for type in types]

        def newest_link(frame: str) -> _Link | None:
            for links in tables:
                link = links.get(frame)
                if link is not None:
                    return link
            return None

        up, down = self._path(target, source, types, newest_link)
        pose = self._product(up, down, None)
        if len(self._cache) >= _MOST_CACHED:
            self._cache.clear()
        self._cache[target, source, types] = _dependencies(up + down, types, tables), pose
        return pose

    def _link_at(self, frame: str, at: float, types: Types) -> _Link | None:
        """The link that is known at that time, or else, with no pose, the one to the newest parent."""
        for type in types:
            histories = self._histories.get((type, frame))
            if histories:
                candidates = _by_newest(histories)
                for parent, history in candidates:
                    pose = history.at(at, self._extrapolation)
                    if pose is not None:
                        return _Link(type, parent, pose)
                return _Link(type, candidates[0][0], None)
        return None

    def _path(
        self, target: str, source: str, types: Types, find: Callable[[str], _Link | None]
    ) -> tuple[_Steps, _Steps]:
        """The steps from the source, and from the target, up to the first frame that both chains share."""
        up = _climb(source, find, until=(target,))
        down = _climb(target, find, until=up)
        meeting = next(reversed(down))
        if meeting not in up:
            raise self._no_path(up, down, types)
        return _steps_below(meeting, up), _steps_below(meeting, down)

    def _product(self, up: _Steps, down: _Steps, at: float | None) -> Pose:
        """target_from_source of the steps from the source and from the target to where they meet."""
        if not down:
            return self._top_from_bottom(up, at)
        target_from_meeting = self._top_from_bottom(down, at).inverse()
        return target_from_meeting @ self._top_from_bottom(up, at) if up else target_from_meeting

    def _top_from_bottom(self, steps: _Steps, at: float | None) -> Pose:
        product: Pose | None = None
        for frame, link in steps:
            if link.pose is None:
                raise self._extrapolation_error(frame, link, at)
            # from the bottom up, a covariance is moved only by the steps that have one
            product = link.pose if product is None else link.pose @ product
        return Pose.identity() if product is None else product

    def _extrapolation_error(self, frame: str, link: _Link, at: float | None) -> ExtrapolationError:
        edge = f"{link.type} edge {link.parent!r} -> {frame!r}"
        history = self._histories.get((link.type, frame), {}).get(link.parent)
        if history is None:
            return ExtrapolationError(f"{edge}: removed while it was asked for its pose at {at} s")
        oldest, newest = history.span
        return ExtrapolationError(
            f"{edge}: no pose at {at:.3f} s; its samples range from {oldest:.3f} s to {newest:.3f} s, "
            f"and the newest is held for {self._extrapolation} s"
        )

    def _no_path(self, up: _Chain, down: _Chain, types: Types) -> TransformError:
        source, target = next(iter(up)), next(iter(down))
        problem = f"no path from {source!r} to {target!r} over {' or '.join(types)} edges"
        for chain in (up, down):
            link = chain[next(reversed(chain))]
            if link is not None:
                cycle = list(chain)[list(chain).index(link.parent) :]
                return TransformError(f"{problem}: cycle {' -> '.join(map(repr, [*cycle, link.parent]))}")
        ends = [self._end(chain, types) for chain in (up, down)]
        return NoPathError(f"{problem}: {ends[0]}; {ends[1]}")

    def _end(self, chain: _Chain, types: Types) -> str:
        """Where a chain ends, for an error message."""
        first, last = next(iter(chain)), next(reversed(chain))
        if first != last:
            return f"the chain of {first!r} ends at {last!r}"
        histories = self._histories.copy()
        frames = {child for _, child in histories} | {parent for by in histories.values() for parent in by}
        if first in frames:
            return f"{first!r} has no such edge to a parent"
        return f"no geometric edge touches {first!r} ({suggest(first, frames)})"


def _by_newest(histories: Mapping[str, PoseHistory]) -> list[tuple[str, PoseHistory]]:
    """The histories by parent, the newest sample first; ties go by name."""
    if len(histories) == 1:
        return list(histories.items())
    return sorted(histories.items(), key=lambda item: (-item[1].newest.stamp, item[0]))


def _climb(frame: str, find: Callable[[str], _Link | None], until: Container[str]) -> _Chain:
    """The frames from this one up to one in `until`, or to the last, or to where they would repeat."""
    chain: _Chain = {}
    while frame not in chain:
        link = chain[frame] = None if frame in until else find(frame)
        if link is None:
            break
        frame = link.parent
    return chain


def _steps_below(meeting: str, chain: _Chain) -> _Steps:
    steps = takewhile(lambda step: step[0] != meeting, chain.items())
    return [(frame, link) for frame, link in steps if link is not None]


def _dependencies(steps: _Steps, types: Types, tables: list[_Links]) -> list[_Dependency]:
    """What must stay for the steps to be taken again: their links, and no edge of a type preferred to one."""
    dependencies: list[_Dependency] = []
    for frame, link in steps:
        rank = types.index(link.type)
        if rank > 0:
            dependencies += [(links, frame, None) for links in tables[:rank]]
        dependencies.append((tables[rank], frame, link))
    return dependencies
