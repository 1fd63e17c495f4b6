"""Learns how often a hand that seems to hold or touch an object does hold it, by circumstance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.recorded import Recorded
from simulation_handler.worlds.circumstances import hold
from simulation_handler.worlds.holders import UNKNOWN, who_may_hold
from simulation_handler.worlds.weighted import WeightedWorlds

HOLDING = "holding"
"""Name of these probabilities in the file, and for `fit --only`"""
_PRIOR = np.array((10.0, 10.0))
"""Moments at which it does, and does not, that are counted beforehand: neither is known without evidence"""
_RESAMPLINGS = 200  # of episodes, by which standard errors are found


def learn_holding(
    episodes: Iterable[tuple[Sequence[Recorded], WeightedWorlds]],
) -> tuple[dict[str, float], dict[str, float]]:
    """Probabilities (0 to 1) by circumstance, and standard errors of their logits, by drawing episodes anew.

    Each episode comes with worlds that have seen nothing yet.
    """
    counts = [_count(moments, worlds) for moments, worlds in episodes]
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(counts), size=(_RESAMPLINGS, len(counts)))
    found, errors = {}, {}
    for circumstance in sorted({circumstance for count in counts for circumstance in count}):
        by_episode = np.array([count.get(circumstance, np.zeros(2)) for count in counts])
        right, wrong = (_PRIOR + by_episode.sum(axis=0)).tolist()
        found[circumstance] = right / (right + wrong)
        resampled = _PRIOR + by_episode[drawn].sum(axis=1)
        errors[circumstance] = float(np.std(np.log(resampled[:, 0] / resampled[:, 1]), ddof=1))
    return found, errors


def _count(moments: Sequence[Recorded], worlds: WeightedWorlds) -> dict[str, NDArray[np.float64]]:
    """Moments of one episode at which the hand does, and does not hold the object, by circumstance."""
    counts: dict[str, NDArray[np.float64]] = defaultdict(lambda: np.zeros(2))
    for moment in moments:
        worlds.update(moment.evidence)
        for name, thing in moment.evidence.objects.items():
            hands = () if thing.gripper else who_may_hold(name, moment.evidence)
            followed = worlds.followed(name) if hands and UNKNOWN not in hands else None
            if followed is not None and name in moment.truth:
                counts[hold(thing, followed.circumstance)][int(moment.held.get(name) not in hands)] += 1.0
    return counts
