"""Whether many things seem to move in one moment: then it may be the camera that was bumped, not they."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

from agents.action_inference.observation import FOUND_OUT, ObservedThing, Snapshot
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import AT_REST, CONFIRMED_IN, SAME_PLACE

_STILL_BEFORE = 2.0 * AT_REST  # s in which a thing must have lain still before it seemed to move
_JUMP = 0.012  # m from there, from which it seems to have moved
_FEW, _NEWEST = 3, 2  # percepts in a row that must show each
FRESH = CONFIRMED_IN
"""s up to which a percept is of a thing as it is now"""
_FEWEST_THINGS = 3  # things that must seem to move, unless there are only two


class Bumps:
    """Compares where things are seen with where they were seen just before."""

    def __init__(self) -> None:
        self._seen: dict[str, deque[Pose]] = {}
        self._last = -math.inf  # s, when many last seemed to move
        self._since = -math.inf  # s, since when

    def update(self, snapshot: Snapshot) -> None:
        """Take in what is seen now."""
        self._seen = {name: seen for name, seen in self._seen.items() if name in snapshot.things}
        for thing in snapshot.things.values():
            if thing.seen is not None:
                self._add(thing.name, thing.seen)
        free = [thing for thing in snapshot.things.values() if self._stands_by_itself(thing, snapshot)]
        moved = sum(self._has_jumped(thing.name) for thing in free)
        if moved >= 2 and 2 * moved >= len(free) and moved >= min(_FEWEST_THINGS, len(free)):
            if snapshot.now - self._last > FOUND_OUT:
                self._since = snapshot.now
            self._last = snapshot.now

    def may_be(self, now: float) -> bool:
        """Whether a camera may have been bumped in the last moments before `now` (s)."""
        return now - self._since <= FOUND_OUT

    def _add(self, name: str, pose: Pose) -> None:
        seen = self._seen.setdefault(name, deque())
        if not seen or pose.stamp > seen[-1].stamp:
            seen.append(pose)
        while seen[0].stamp < pose.stamp - _STILL_BEFORE:
            seen.popleft()

    @staticmethod
    def _stands_by_itself(thing: ObservedThing, snapshot: Snapshot) -> bool:
        is_seen = thing.perceived and thing.seen is not None and snapshot.now - thing.seen.stamp <= FRESH
        return is_seen and not thing.grasps and snapshot.things.keys().isdisjoint(thing.on | thing.inside)

    def _has_jumped(self, name: str) -> bool:
        places = [pose.t for pose in self._seen[name]]
        newest, before = places[-_NEWEST:], places[:-_NEWEST]
        return any(min(math.dist(place, centre) for place in newest) > _JUMP for centre in _still(before))


def _still(places: list[Vector3]) -> Iterator[Vector3]:
    """Where it lay still, in the middle of each few places in a row that are together."""
    for end in range(_FEW, len(places) + 1):
        few = places[end - _FEW : end]
        if max(math.dist(one, few[0]) for one in few) < SAME_PLACE:
            x, y, z = (sum(values) / _FEW for values in zip(*few, strict=True))
            yield (x, y, z)
