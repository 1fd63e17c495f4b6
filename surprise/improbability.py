"""How improbable what was seen lately is under the whole belief, in nats: of things, hands and cameras, and of all.

The belief about a thing is a set of alternatives with weights (`Memory.belief`). What is seen is as probable as it is
under each, weighed. The belief of before counts: alternatives that percepts propose explain these percepts always.
Nothing counts as less probable than that something nobody thought of has happened. What ordinary percepts cost is 0.
From `SURPRISING` of `dsr.vocabulary.nats` it is surprising.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from dsr.believing.distribution import Alternative, Whereabouts, are_at_one_place
from dsr.errors import DsrError
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.nats import AS_GOOD, FALSE_FRAME, MOST_MISFIT
from surprise.config import SurpriseConfig
from surprise.deviation import compare
from surprise.evidence import KEPT, EvidenceTrack
from surprise.misfit import log_tail_of_three, misfit

ATTRIBUTE = "nats"
"""Of things, hands and cameras, and for all together of the root node `world`."""
_SAME_NATS = 0.5 * AS_GOOD  # nats, by which it may change before it is written again: two such changes tell


class LatelySeen(NamedTuple):
    """What cameras tell lately of one thing."""

    tracks: Sequence[EvidenceTrack] = ()
    """Of each camera that recognised the thing lately"""
    missed: float = 0.0
    """nats, of frames in which a camera should have seen the thing where it is believed most, and did not"""
    though_hidden: float = 0.0
    """nats, of percepts of the thing though another one should hide it where it is believed most"""
    while_gone: int = 0
    """Percepts since the thing is believed to be gone."""
    false: float = FALSE_FRAME
    """nats, that a percept is false"""


def improbability(where: Whereabouts, seen: LatelySeen, config: SurpriseConfig) -> float:
    """How improbable what is seen of a thing is, nats: from 0 to `MOST_MISFIT`.

    `where` is the belief before the evidence that `seen` tells of.
    """
    whole = sum(one.weight * math.exp(-_cost(one, where.best, seen, config)) for one in where.alternatives)
    return max(-math.log(whole + math.exp(-MOST_MISFIT)), 0.0)


def at_most(where: Whereabouts, seen: LatelySeen, config: SurpriseConfig) -> float:
    """What `improbability` is at most, nats, by the most probable alternative alone: this takes much less time."""
    return _cost(where.best, where.best, seen, config) - math.log(max(where.best.weight, math.exp(-MOST_MISFIT)))


def silence(seconds: float, pause: float) -> float:
    """How improbable it is that a camera that should see something shows nothing for so long, nats.

    Args:
        seconds: s for which it shows nothing, beyond the time between its frames.
        pause: s, mean of such times of a camera with which nothing is wrong.
    """
    return min(seconds / pause, MOST_MISFIT)


class HandMotion:
    """The last percepts of one hand: how improbable they are as those of one motion.

    Hands are seen anywhere, and nothing is believed of where they go. So the motion itself must be improbable, and the
    belief about a hand is that it is somewhere about where it was last.
    """

    def __init__(self, config: SurpriseConfig) -> None:
        self._config = config
        self._poses: deque[Pose] = deque(maxlen=KEPT)

    def add(self, pose: Pose) -> None:
        """Take in world_from_hand, with its stamp."""
        if self._poses and pose.stamp <= self._poses[-1].stamp:
            if pose.stamp < self._poses[-1].stamp - self._config.fresh:
                self._poses.clear()  # the clock was set back
            else:
                return
        self._poses.append(pose)

    def improbability(self, now: float) -> float:
        """Nats at time `now` (s), by the most probable choice of those percepts that are false."""
        poses, speed, noise = list(self._poses), self._config.hand_speed, self._config.hand_noise
        if not poses or now - poses[-1].stamp > self._config.fresh:
            return 0.0
        costs: list[float] = []  # of all percepts up to each one, if that one is true
        for place, pose in enumerate(poses):
            skipping = [
                costs[before] + FALSE_FRAME * (place - before - 1) + jump(poses[before], pose, speed, noise)
                for before in range(place)
            ]
            costs.append(min([FALSE_FRAME * place, *skipping]))
        return min(cost + FALSE_FRAME * (len(poses) - 1 - place) for place, cost in enumerate(costs))


def jump(before: Pose, after: Pose, speed: float, noise: float) -> float:
    """How improbable it is that a hand moved so far in that time, nats beyond what ordinary motions cost.

    Args:
        before: world_from_hand, with stamp.
        after: the same later.
        speed: m/s, standard deviation of each part of a hand's velocity.
        noise: m, standard deviation of each coordinate of a percept.
    """
    seconds = max(after.stamp - before.stamp, 0.0)
    variance = (speed * seconds) ** 2 + 2.0 * noise**2
    half = 0.5 * math.dist(before.t, after.t) ** 2 / variance
    ordinary = 1.0  # nats: minus the logarithm of a tail probability has this mean
    return min(max(-log_tail_of_three(half) - ordinary, 0.0), MOST_MISFIT)


class ImprobabilityWriter:
    """Writes nats where they have changed, and their sum at the root node.

    Args:
        memory: where to.
        root: name of the root node.
    """

    def __init__(self, memory: Memory, root: str) -> None:
        self._memory = memory
        self._root = root

    def update(self, nats: Iterable[tuple[str, float]]) -> None:
        """Write those of all things, hands and cameras, by name, as of now."""
        total = 0.0
        for name, own in nats:
            total += own
            self._write(name, own)
        self._write(self._root, total)

    def _write(self, name: str, nats: float) -> None:
        node = self._memory.get_node(name)
        known = None if node is None else node.get(ATTRIBUTE)
        if node is None or (known is not None and abs(known - nats) < _SAME_NATS):
            return
        try:
            self._memory.update_node(name, **{ATTRIBUTE: round(nats, 1)})
        except DsrError:  # it has just been removed
            return


def _cost(one: Alternative, best: Alternative, seen: LatelySeen, config: SurpriseConfig) -> float:
    """What is seen costs so much under one alternative, nats.

    Of several cameras and kinds of evidence the one counts that tells most. They are no independent evidence: errors of
    the belief are the same for all, and what moved a thing makes it both seen elsewhere and missing.
    """
    if one.pose is None:
        return seen.false * max(seen.while_gone, *(len(track.span()) for track in seen.tracks), 0)
    is_best = are_at_one_place(one, best)
    found = [seen.missed, seen.though_hidden] if is_best else [0.0]
    for track in seen.tracks:
        if is_best:
            found.append(track.misfit(seen.false).nats)
        else:
            there = [compare(sighting.pose, sighting.eye, one.pose, config) for sighting in track.span()]
            found.append(misfit(there, track.bias, seen.false).nats)
    return max(found)
