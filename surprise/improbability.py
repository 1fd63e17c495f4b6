"""How improbable what was seen lately is under the whole belief, in nats: of things, hands and cameras, and of all.

The belief about a thing is a set of alternatives with weights (`Memory.belief`). What is seen is as probable as it is
under each, weighed. The belief of before counts: alternatives that percepts propose explain these percepts always.
Nothing counts as less probable than that something nobody thought of has happened.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import NamedTuple

from dsr.believing.distribution import Alternative, Whereabouts, are_at_one_place
from dsr.errors import DsrError
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.nats import CAMERA_MOVED, MISSED_FRAME, MOST_MISFIT, MOST_MISSED, SEEN_THOUGH_HIDDEN
from surprise.config import SurpriseConfig
from surprise.deviation import Deviation, compare
from surprise.evidence import EvidenceTrack

ATTRIBUTE = "nats"
"""Of things, hands and cameras, and for all together of the root node `world`."""
_SAME_NATS = 0.5  # nats, by which it may change before it is written again


class LatelySeen(NamedTuple):
    """What cameras tell lately of one thing."""

    tracks: Sequence[EvidenceTrack] = ()
    """Of each camera that recognised the thing lately"""
    missed: int = 0
    """Frames of a camera that should see the thing where it is believed most, and did not, since the last percept"""
    though_hidden: bool = False
    """Whether it is seen although another thing should hide it where it is believed most"""


def improbability(where: Whereabouts, seen: LatelySeen, config: SurpriseConfig) -> float:
    """How improbable what is seen of a thing is, nats: from 0 to `MOST_MISFIT`.

    `where` is the belief before the evidence that `seen` tells of.
    """
    whole = sum(one.weight * math.exp(-_misfit(one, where.best, seen, config)) for one in where.alternatives)
    return max(-math.log(whole + math.exp(-MOST_MISFIT)), 0.0)


def silence(seconds: float, interval: float) -> float:
    """How improbable it is that a camera that should see something shows nothing for so long, nats.

    Args:
        seconds: s since its last frame, or since it should see something.
        interval: s between its frames.
    """
    missed = MISSED_FRAME * max(seconds / interval - 1.0, 0.0)
    return max(-math.log(math.exp(-missed) + math.exp(-CAMERA_MOVED)), 0.0)


def jump(before: Pose, after: Pose, speed: float, noise: float) -> float:
    """How improbable it is that a hand moved so far in that time, nats.

    Args:
        before: world_from_hand, with stamp.
        after: the same later.
        speed: m/s, standard deviation of each part of a hand's velocity.
        noise: m, standard deviation of each coordinate of a percept.
    """
    seconds = max(after.stamp - before.stamp, 0.0)
    variance = (speed * seconds) ** 2 + 2.0 * noise**2
    squared = math.dist(before.t, after.t) ** 2 / variance
    return min(-_log_tail_of_three(squared), MOST_MISFIT)


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


def _misfit(one: Alternative, best: Alternative, seen: LatelySeen, config: SurpriseConfig) -> float:
    """How badly an alternative explains what is seen, nats."""
    is_best = are_at_one_place(one, best)
    nats = min(seen.missed * MISSED_FRAME, MOST_MISSED) if is_best and one.pose is not None else 0.0
    for track in seen.tracks:
        if one.pose is None:
            nats += MOST_MISFIT
            continue
        last = track.last(config.needed)
        known = [sighting.deviation for sighting in last]
        if not is_best:
            known = [compare(sighting.pose, sighting.eye, one.pose, config) for sighting in last]
        if known:
            nats -= _log_tail_of_six(fmean(_squared(deviation, track.bias) for deviation in known))
    if seen.though_hidden and is_best:
        nats += SEEN_THOUGH_HIDDEN
    return nats


def _squared(deviation: Deviation, bias: float | None) -> float:
    """Squared Mahalanobis distance of a percept, of six coordinates."""
    depth = (deviation.depth - (bias or 0.0)) / deviation.depth_std
    return deviation.beside_sigmas**2 + depth**2 + deviation.turn_sigmas**2


def _log_tail_of_six(squared: float) -> float:
    """Logarithm of the probability that a squared Mahalanobis distance of six coordinates is at least that great."""
    half = 0.5 * squared
    return -half + math.log1p(half + 0.5 * half**2)


def _log_tail_of_three(squared: float) -> float:
    """Likewise of three coordinates."""
    half = 0.5 * squared
    tail = math.erfc(math.sqrt(half)) + 2.0 * math.sqrt(half / math.pi) * math.exp(-half)
    return math.log(max(tail, sys.float_info.min))
