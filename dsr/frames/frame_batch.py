"""Many transforms at once: the frames around one target as a tree, multiplied level by level with numpy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from itertools import chain, pairwise
from typing import Any

import numpy as np

from dsr.frames.frame_chain import MOST_STEPS, Dependency, Find, Link, climb, factor
from dsr.math3d import quaternions
from dsr.math3d.transforms import Array, Pose

Depend = Callable[[str, Link | None], list[Dependency]]
"""Lists the dependencies of a link: while they stay, `Find` gives the same link."""
_UNKNOWN = Pose.unchecked((math.nan,) * 3, (math.nan,) * 4)


class _Frames:
    """The frames between one target and many sources, as a tree with the target at its root.

    Frames of which no chain leads to the target make trees of their own, with an unknown root.
    """

    def __init__(self, target: str, sources: Sequence[str], find: Find) -> None:
        self.numbers: dict[str, int] = {}
        """By frame, in an order where parents precede their children."""
        self.parents: list[int] = []
        """By frame number; a root is its own parent."""
        self.depths: list[int] = []
        """By frame number."""
        self.poses: list[Pose | None] = []
        """By frame number: parent_from_frame in this tree, None where it is unknown."""
        self.steps: list[tuple[str, Link | None, int | None]] = []
        """What `find` told of a frame, and the number of the frame whose pose that is."""
        self._find = find
        self._descend(target)
        for source in sources:
            self._climb(source)

    def _descend(self, target: str) -> None:
        """Add the target and, hanging from it upside down, the chain above it, up to where it enters a cycle."""
        path = climb(target, self._find, until=())
        last = next(reversed(path))
        end = path[last]
        top = last if end is None else end.parent
        self._add(target, None, Pose.identity())
        if len(path) > MOST_STEPS:
            del path[last]  # what is above it does not matter
        for frame, link in path.items():
            number = None
            if link is not None and top not in self.numbers:
                number = self._add(link.parent, frame, factor(link, inverted=True))
            self.steps.append((frame, link, number))

    def _climb(self, source: str) -> None:
        """Add the frames from a source up to one that is there already, to the last, or to where they repeat.

        Of a source that is too far away, only itself is added: the frames above may be near enough.
        """
        path = climb(source, self._find, until=self.numbers)
        if len(path) > MOST_STEPS and next(reversed(path)) not in self.numbers:
            self._add(source, None, None)
            self.steps += [(frame, link, None) for frame, link in path.items() if link is not None]
            return
        for frame, link in reversed(path.items()):
            if frame in self.numbers:
                continue
            above = None if link is None else self.numbers.get(link.parent)
            if link is None or above is None or self.depths[above] >= MOST_STEPS:
                self._add(frame, None, None)
                self.steps.append((frame, link, None))
            else:
                self.steps.append((frame, link, self._add(frame, link.parent, link.pose)))

    def _add(self, frame: str, parent: str | None, pose: Pose | None) -> int:
        number = self.numbers[frame] = len(self.numbers)
        self.parents.append(number if parent is None else self.numbers[parent])
        self.depths.append(0 if parent is None else self.depths[self.parents[number]] + 1)
        self.poses.append(pose)
        return number


class Batch:
    """target_from_source of many sources, as it was at one moment; immutable.

    Frames stand level by level, so that the matrices of a whole level are one product of two arrays.

    Args:
        target: the frame to express the others in.
        sources: the frames asked for.
        find: tells the links.
        depend: tells what must stay for them to stay; a batch without is not to be renewed.
    """

    def __init__(self, target: str, sources: Sequence[str], find: Find, depend: Depend = lambda *_: []) -> None:
        frames = _Frames(target, sources, find)
        depths = np.array(frames.depths)
        order = np.argsort(depths, kind="stable")
        places = np.empty_like(order)
        places[order] = np.arange(len(order))
        self._sources = places[[frames.numbers[source] for source in sources]]
        self._parents = places[np.array(frames.parents)[order]]
        self._levels = list(pairwise(np.searchsorted(depths[order], np.arange(depths.max() + 2)).tolist()))
        self._dependencies: list[Dependency] = []
        self._places: list[tuple[int | None, bool]] = []  # by dependency: where its pose stands, whether inverted
        for frame, link, number in frames.steps:
            place = None if number is None else int(places[number])
            for dependency in depend(frame, link):
                self._dependencies.append(dependency)
                self._places.append((place, number != frames.numbers.get(frame)))
        self._multiply(_matrices([frames.poses[i] for i in order.tolist()]))

    def _multiply(self, factors: Array) -> None:
        """Set the matrices, given parent_from_frame of each frame."""
        self._factors = factors
        self._matrices = factors.copy()
        for begin, end in self._levels[1:]:
            parents = self._matrices[self._parents[begin:end]]
            np.matmul(parents, factors[begin:end], out=self._matrices[begin:end])

    def transforms(self) -> Array:
        """(n, 4, 4) homogeneous matrices in the order of the sources; NaN but for the last row where unknown."""
        result: Array = self._matrices[self._sources]
        return result

    def renewed(self) -> Batch | None:
        """The batch by the present links; None if one of them leads elsewhere now."""
        changed: list[tuple[int, Link]] = []
        for i, (links, frame, old) in enumerate(self._dependencies):
            new = links.get(frame)
            if new is not old:
                if new is None or old is None or new.parent != old.parent:
                    return None
                changed.append((i, new))
        return self._with(changed) if changed else self

    def _with(self, changed: list[tuple[int, Link]]) -> Batch:
        batch = copy(self)
        batch._dependencies = self._dependencies.copy()
        places: list[int] = []
        poses: list[Pose | None] = []
        for i, link in changed:
            links, frame, _ = self._dependencies[i]
            batch._dependencies[i] = links, frame, link
            place, inverted = self._places[i]
            if place is not None:
                places.append(place)
                poses.append(factor(link, inverted))
        factors = self._factors.copy()
        factors[places] = _matrices(poses)
        batch._multiply(factors)
        return batch


def _matrices(poses: Sequence[Pose | None]) -> Array:
    """(n, 4, 4) homogeneous matrices of poses; NaN but for the last row where there is none."""
    known = [_UNKNOWN if pose is None else pose for pose in poses]
    q: Any = np.fromiter(chain.from_iterable([pose.q for pose in known]), np.float64).reshape(-1, 4).T
    matrices = np.zeros((len(known), 4, 4))
    matrices[:, :3, :3] = np.moveaxis(np.array(quaternions.to_matrix(q)), 2, 0)
    matrices[:, :3, 3] = np.fromiter(chain.from_iterable([pose.t for pose in known]), np.float64).reshape(-1, 3)
    matrices[:, 3, 3] = 1.0
    return matrices
