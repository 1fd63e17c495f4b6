"""Where is one frame, seen from another: chains of geometric edges, over time.

A frame's chain follows its incoming edges upwards: at each frame the first edge type of `types` that has
one, and among several parents of that type (two cameras see one cube) the one with the newest sample.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import takewhile
from typing import Protocol

from dsr.errors import CycleError, ExtrapolationError, NoPathError, TransformError, suggest
from dsr.frames.frame_batch import Batch
from dsr.frames.frame_chain import MOST_STEPS, Chain, Dependency, Find, Link, Links, Newest, Path, climb
from dsr.frames.parents import Parents
from dsr.frames.pose_history import PoseHistory
from dsr.math3d.transforms import Array, Pose

WORLD = "world"
BELIEVED: Types = ("Virtual_RT", "RT")
"""Edge types by which each frame is where it is believed to be, if it is, else where it was perceived or measured."""
"""Name of the frame at the root of all others."""

Types = tuple[str, ...]

_MOST_CHAINS = 4096
_MOST_BATCHES = 64
_MOST_STEPS = 64
"""Frames above one that hangs elsewhere that are looked at: more than a robot's arm has, and few, for one message may
bring a chain of any length, frame by frame."""


_Chains = dict[tuple[str, str, Types], Chain]
_Steps = list[tuple[str, Link]]
"""The part of a chain that a transform is made of."""


class _ApartError(Exception):
    """The ways up from two frames do not meet."""

    def __init__(self, up: Path, down: Path) -> None:
        super().__init__()
        self.up, self.down = up, down


class FrameFork(Protocol):
    """A tree that began as another one and still reads from it."""

    def take_over(self, type: str, child: str) -> None:
        """The other tree is about to change the edges of this type to `child`: keep them as they are."""


class FrameTree:
    """The geometric edges of a graph with their recent past, asked for transforms between any two frames.

    Any number of threads may call `transform` while one at a time calls `update` and `remove`, without a
    lock: every link that a reader uses is an immutable value, replaced as a whole, and of samples a reader takes a
    copy. A result is made of one consistent value per edge; edges that change meanwhile are seen by the next call.

    Args:
        history: s, how far back the samples of an edge are kept.
        samples: how many samples of an edge are kept at most.
        extrapolation: s, how long after its newest sample an edge may be asked; it is held constant.
    """

    def __init__(self, *, history: float = 10.0, samples: int = 512, extrapolation: float = 0.1) -> None:
        self._history = history
        self._samples = samples
        self._extrapolation = extrapolation
        self._histories: dict[tuple[str, str], Parents] = {}  # by (type, child)
        self._newest: dict[str, Links] = {}  # type -> child -> link to the parent with the newest sample
        self._chains: _Chains = {}
        self._batches: dict[tuple[str, tuple[str, ...], Types], Batch] = {}
        self._owned: set[tuple[str, str]] | None = None
        """If histories are shared with forks: those (type, child) that nobody else reads; others are copied first."""
        self._forks: list[weakref.ref[FrameFork]] = []
        self._overlays: list[weakref.ref[FrameTree]] = []

    def update(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """Record the sample parent_from_child of an edge; it need not be the newest.

        The stamp 0.0 means "always". A sample equal to the one of its stamp changes nothing.
        """
        if self._owned is not None:
            self._before_change(type, child)
        histories = self._histories.get((type, child))
        if histories is None:
            histories = self._histories[type, child] = Parents()
        if parent in histories:
            histories[parent].add(pose)
        else:
            histories[parent] = PoseHistory(pose, self._history, self._samples)
        self._choose_newest(type, child, parent)

    def follow(self, type: str, parent: str, child: str, pose: Pose) -> None:
        """Let `pose` be the newest sample of an edge: those of later stamps lost against it, and are forgotten.

        What a graph shows is the write that won, whatever its stamp; so all replicas have the same transforms.
        """
        if self._owned is not None:
            self._before_change(type, child)
        histories = self._histories.get((type, child))
        if histories is None or parent not in histories:
            self.update(type, parent, child, pose)
            return
        history = histories[parent]
        if pose.stamp >= history.newest.stamp:
            history.add(pose)
        else:
            history.end_with(pose)
        if len(histories) == 1 and history.newest is pose:
            self._links(type)[child] = Link(type, parent, pose)
        else:
            self._choose_newest(type, child, parent)

    def since(self, type: str, parent: str, child: str, time: float) -> list[Pose]:
        """The kept samples of an edge with later stamps than `time` s, the oldest first."""
        histories = self._histories.get((type, child))
        history = None if histories is None else histories.get(parent)
        return [] if history is None else history.since(time)

    def remove(self, type: str, parent: str, child: str) -> None:
        """Forget an edge and its past; harmless if there is none."""
        if self._owned is not None:
            self._before_change(type, child)
        histories = self._histories.get((type, child))
        if histories is not None and histories.pop(parent, None) is not None:
            self._choose_newest(type, child, parent)

    def share_with(self, fork: FrameFork) -> None:
        """Let `fork` read the present content, and keep later changes from it."""
        self._forks = [other for other in self._forks if other() is not None] + [weakref.ref(fork)]
        self._owned = set()

    def _before_change(self, type: str, child: str) -> None:
        """Let the forks keep the edges to this frame as they are, and go on with a copy."""
        key = type, child
        if self._owned is None or key in self._owned:
            return
        for reference in self._forks:
            fork = reference()
            if fork is not None:
                fork.take_over(type, child)
        histories = self._histories.get(key)
        if histories is not None:
            self._histories[key] = histories.copied()
        self._owned.add(key)

    def _choose_newest(self, type: str, child: str, changed: str) -> None:
        """Let the table name the newest of the frame's edges, of which that from `changed` has changed.

        A link that is still right stays the same.
        """
        links = self._links(type)
        histories, link = self._histories[type, child], links.get(child)
        if not histories:
            del self._histories[type, child]
            links.pop(child, None)
        else:
            if changed in histories:
                histories.note(changed)
            parent = histories.newest()
            pose = histories[parent].newest
            if link is not None and link.parent == parent:
                if link.pose is not pose:
                    links[child] = Link(type, parent, pose)
                return
            links[child] = Link(type, parent, pose)
        self.hangs_elsewhere(child)

    def show_through(self, overlay: FrameTree) -> None:
        """Tell `overlay`, which looks through to this tree, when a frame hangs elsewhere."""
        self._overlays = [other for other in self._overlays if other() is not None] + [weakref.ref(overlay)]

    def hangs_elsewhere(self, child: str) -> None:
        """Forget all chains if this frame may be in a circle: two ways lead round it, and theirs may not be the one."""
        if not (self._chains or self._batches) or self._may_be_in_circle(child):
            self._chains, self._batches = {}, {}  # not emptied: what a reader is working out now must not come in
        for reference in self._overlays:
            overlay = reference()
            if overlay is not None:
                overlay.hangs_elsewhere(child)

    def _may_be_in_circle(self, child: str) -> bool:
        """Whether a way leads up from a frame to itself, or further than `_MOST_STEPS` frames are looked at."""
        types, seen, waiting = self.types(), {child}, [child]
        while waiting and len(seen) <= _MOST_STEPS:
            frame = waiting.pop()
            parents = {link.parent for type in types if (link := self.link(type, frame)) is not None}
            if child in parents:
                return True
            waiting += parents - seen
            seen |= parents
        return bool(waiting)

    def _links(self, type: str) -> Links:
        """The table of one edge type; it stays the same object."""
        return self._newest.get(type) or self._newest.setdefault(type, {})

    def types(self) -> set[str]:
        """The types of the edges, or more."""
        return set(self._newest)

    def link(self, type: str, child: str) -> Link | None:
        """The link of this type to the parent with the newest sample; None if there is none."""
        return self._links(type).get(child)

    def depend_on(self, type: str, child: str, link: Link | None) -> list[Dependency]:
        """List the dependencies of this link: while they stay, `link` gives the same answer again."""
        return [(self._links(type), child, link)]

    def histories(self, type: str, child: str) -> Parents | None:
        """The samples of all edges of this type to `child`, by parent; neither is to be changed."""
        return self._histories.get((type, child))

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
            CycleError: if they do not meet because edges form a cycle.
        """
        try:
            return self._transform(target, source, at, types)
        except _ApartError as apart:
            raise self._no_path(apart.up, apart.down, types) from None

    def find(self, target: str, source: str, at: float | None = None, types: Types = ("RT",)) -> Pose | None:
        """As `transform`; None where that raises, at the cost of the way alone: to say why looks at all frames."""
        try:
            return self._transform(target, source, at, types)
        except (_ApartError, TransformError):
            return None

    def _transform(self, target: str, source: str, at: float | None, types: Types) -> Pose:
        if at is not None:
            up, down = self._path(target, source, types, lambda frame: self._link_at(frame, at, types))
            return self._product(up, down, at).with_stamp(at)
        chains = self._chains
        chain = chains.get((target, source, types))
        if chain is None:
            return self._newest_chain(chains, target, source, types).pose
        for links, frame, link in chain.dependencies:
            if links.get(frame) is not link:
                renewed = chain.renewed()
                if renewed is None:
                    return self._newest_chain(chains, target, source, types).pose
                chains[target, source, types] = renewed
                return renewed.pose
        return chain.pose

    def _newest_chain(self, chains: _Chains, target: str, source: str, types: Types) -> Chain:
        """The chain by the newest samples; it is kept in `chains`, which were taken before a sample was read."""
        newest = self._newest_links(types)
        up, down = self._path(target, source, types, newest.find)
        steps = [*down, *reversed(up)]
        chain = Chain([d for frame, link in steps for d in newest.depend(frame, link)], inverted=len(down))
        if len(chains) >= _MOST_CHAINS:
            chains.clear()
        chains[target, source, types] = chain
        return chain

    def transforms(self, target: str, sources: Sequence[str], at: float | None = None, types: Types = ("RT",)) -> Array:
        """target_from_source of many frames at once.

        The same request again costs by the edges that changed meanwhile, and one look at each of the others.

        Args:
            target: as in `transform`.
            sources: the frames asked for, n of them.
            at: as in `transform`.
            types: as in `transform`.

        Returns:
            (n, 4, 4) homogeneous matrices, translations in m. Without a path, or where a pose is not known at
            that time, a matrix is NaN but for its last row. For stamps and covariances ask `transform`.

        Raises:
            TypeError: if `sources` is one name instead of several.
        """
        if isinstance(sources, str):
            raise TypeError(f"sources {sources!r}: expected several names, as in [{sources!r}]")
        if at is not None:
            return Batch(target, sources, lambda frame: self._link_at(frame, at, types)).transforms()
        request = (target, tuple(sources), types)
        batches = self._batches
        batch = batches.get(request)
        renewed = None if batch is None else batch.renewed()
        if renewed is None:
            newest = self._newest_links(types)
            renewed = Batch(target, sources, newest.find, newest.depend)
        if renewed is not batch:
            if len(batches) >= _MOST_BATCHES:
                batches.clear()
            batches[request] = renewed
        return renewed.transforms()

    def _newest_links(self, types: Types) -> Newest:
        return Newest(types, [self._links(type) for type in types])

    def _link_at(self, frame: str, at: float, types: Types) -> Link | None:
        """The link that is known at that time, or else, with no pose, the one to the newest parent."""
        for type in types:
            histories = self._histories.get((type, frame))
            candidates = _by_newest(histories) if histories else []
            if candidates:
                for parent, history in candidates:
                    pose = history.at(at, self._extrapolation)
                    if pose is not None:
                        return Link(type, parent, pose)
                return Link(type, candidates[0][0], None)
        return None

    def _path(
        self, target: str, source: str, types: Types, find: Find
    ) -> tuple[_Steps, _Steps]:
        """The steps from the source, and from the target, up to the first frame that both chains share."""
        up = climb(source, find, until=(target,))
        down = climb(target, find, until=up)
        meeting = next(reversed(down))
        steps = (_steps_below(meeting, up), _steps_below(meeting, down)) if meeting in up else None
        if steps is None or len(steps[0]) + len(steps[1]) > MOST_STEPS:
            raise _ApartError(up, down)
        return steps

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

    def _extrapolation_error(self, frame: str, link: Link, at: float | None) -> ExtrapolationError:
        edge = f"{link.type} edge {link.parent!r} -> {frame!r}"
        histories = self._histories.get((link.type, frame))
        history = None if histories is None else histories.get(link.parent)
        if history is None:
            return ExtrapolationError(f"{edge}: removed while it was asked for its pose at {at} s")
        oldest, newest = history.span
        return ExtrapolationError(
            f"{edge}: no pose at {at:.3f} s; its samples range from {oldest:.3f} s to {newest:.3f} s, "
            f"and the newest is held for {self._extrapolation} s"
        )

    def _no_path(self, up: Path, down: Path, types: Types) -> TransformError:
        source, target = next(iter(up)), next(iter(down))
        problem = f"no path from {source!r} to {target!r} over {' or '.join(types)} edges"
        if len(up) + len(down) > MOST_STEPS:
            return NoPathError(f"{problem}: more than {MOST_STEPS} edges are above them, or between them")
        for chain in (up, down):
            link = chain[next(reversed(chain))]
            if link is not None:
                cycle = list(chain)[list(chain).index(link.parent) :]
                return CycleError(f"{problem}: cycle {' -> '.join(map(repr, [*cycle, link.parent]))}")
        ends = [self._end(chain, types) for chain in (up, down)]
        return NoPathError(f"{problem}: {ends[0]}; {ends[1]}")

    def _end(self, chain: Path, types: Types) -> str:
        """Where a chain ends, for an error message."""
        first, last = next(iter(chain)), next(reversed(chain))
        if first != last:
            return f"the chain of {first!r} ends at {last!r}"
        histories = self._histories.copy()
        if any(first == child for _, child in histories) or any(first in by for by in histories.values()):
            return f"{first!r} has no such edge to a parent"
        frames = {child for _, child in histories} | {parent for by in histories.values() for parent in by.copy()}
        return f"no geometric edge touches {first!r} ({suggest(first, frames)})"


def _by_newest(histories: Parents) -> list[tuple[str, PoseHistory]]:
    """The histories by parent, the newest sample first; ties go by name."""
    items = list(histories.copy().items())  # at one moment: `list(d.items())` lets others run
    return items if len(items) == 1 else sorted(items, key=lambda item: (-item[1].newest.stamp, item[0]))


def _steps_below(meeting: str, chain: Path) -> _Steps:
    steps = takewhile(lambda step: step[0] != meeting, chain.items())
    return [(frame, link) for frame, link in steps if link is not None]
