"""Learns how often a hand that seems to hold or touch an object does hold it, by circumstance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

from benchmarks.learning.recorded import Recorded
from simulation_handler.worlds.weighted import WeightedWorlds

_PRIOR = 10.0, 10.0
"""Moments at which it does, and does not, that are counted beforehand: neither is known without evidence"""


def learn_holding(episodes: Iterable[tuple[Sequence[Recorded], WeightedWorlds]]) -> dict[str, float]:
    """Probabilities (0 to 1) by circumstance; each episode with worlds that have seen nothing yet."""
    counts: dict[str, list[float]] = defaultdict(lambda: list(_PRIOR))
    for moments, worlds in episodes:
        for moment in moments:
            worlds.update(moment.evidence)
            for name, thing in moment.evidence.objects.items():
                hand = thing.hand or next(iter(thing.touched_by), "")
                followed = worlds.followed(name) if hand and not thing.gripper else None
                if followed is not None and name in moment.truth:
                    counts[followed.circumstance][moment.held.get(name) != hand] += 1.0
    return {circumstance: right / (right + wrong) for circumstance, (right, wrong) in sorted(counts.items())}
