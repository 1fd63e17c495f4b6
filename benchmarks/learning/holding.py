"""Learns how often a hand that seems to hold or touch an object does hold it, by circumstance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.learning.recorded import Recorded
from simulation_handler.worlds.circumstances import hold
from simulation_handler.worlds.weighted import WeightedWorlds

HOLDING = "holding"
"""Name of these probabilities in the file, and for `fit --only`"""
_PRIOR = (1.0, 1.0)
"""Spells in which it does, and does not, that are counted beforehand: each probability is as likely (Laplace)"""
Spell = tuple[float, float]
"""Moments in a row at which one hand does, and does not, hold one object in one circumstance"""
_RESAMPLINGS = 200  # of episodes, by which standard errors are found


def learn_holding(
    episodes: Iterable[tuple[Sequence[Recorded], WeightedWorlds]],
) -> tuple[dict[str, float], dict[str, float]]:
    """Probabilities (0 to 1) by circumstance, and standard errors of their logits, by drawing episodes anew.

    Each episode comes with worlds that have seen nothing yet. What happens in one spell is much alike: the hand holds
    the object all the time, or never. So moments tell the share, and spells how much it tells.
    """
    counts = [_count(moments, worlds) for moments, worlds in episodes]
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(counts), size=(_RESAMPLINGS, len(counts)))
    found, errors = {}, {}
    for circumstance in sorted({circumstance for count in counts for circumstance in count}):
        by_episode = [count.get(circumstance, []) for count in counts]
        found[circumstance] = probability_of(by_episode)
        resampled = np.array([probability_of([by_episode[index] for index in one]) for one in drawn.tolist()])
        errors[circumstance] = float(np.std(np.log(resampled / (1.0 - resampled)), ddof=1))
    return found, errors


def probability_of(by_episode: Sequence[Sequence[Spell]]) -> float:
    """The posterior mean of the share of moments, of as many alike ones as say as much as the spells do.

    That is Kish's effective sample size of spells of unequal lengths: (sum n)^2 / sum n^2.
    """
    spells = np.array([spell for spells in by_episode for spell in spells], dtype=np.float64).reshape(-1, 2)
    lengths, (right, before) = spells.sum(axis=1), (_PRIOR[0], sum(_PRIOR))
    if not len(spells):
        return right / before
    effective, share = lengths.sum() ** 2 / (lengths**2).sum(), spells[:, 0].sum() / lengths.sum()
    return float((right + effective * share) / (before + effective))


def _count(moments: Sequence[Recorded], worlds: WeightedWorlds) -> dict[str, list[Spell]]:
    """The spells of one episode by circumstance."""
    spells: dict[str, list[Spell]] = defaultdict(list)
    before: dict[tuple[str, str, str], Spell] = {}
    for moment in moments:
        worlds.update(moment.evidence)
        lasting: dict[tuple[str, str, str], Spell] = {}
        for name, thing in moment.evidence.objects.items():
            hand = thing.hand or next(iter(thing.touched_by), "")
            followed = worlds.followed(name) if hand and not thing.gripper else None
            if followed is not None and name in moment.truth:
                key = name, hand, hold(thing, followed.circumstance)
                right, wrong = before.pop(key, (0.0, 0.0))
                holds = moment.held.get(name) == hand
                lasting[key] = right + holds, wrong + (not holds)
        for (_, _, circumstance), spell in before.items():
            spells[circumstance].append(spell)
        before = lasting
    for (_, _, circumstance), spell in before.items():
        spells[circumstance].append(spell)
    return spells
