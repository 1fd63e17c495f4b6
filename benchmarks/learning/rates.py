"""Learns the rates of unseen events and of recognition: maximum likelihood, one value after the other by a parabola."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.judged import Episode, log_scores
from dsr.believing.absence import Absence
from simulation_handler.worlds.parameters import Elsewhere, Rates, Within, WorldParameters

Array = NDArray[np.float64]

RATES = Rates(moved=0.002, moved_by_hand=0.05, taken=0.05, put_down=0.1, removed=0.002, stayed=1.0, kept=0.1,
              entered=0.2, went_on=0.5, astray=0.1, work=0.1, work_removed=0.1, work_moved=0.1, missed=0.5,
              vanished=0.5, slipped=0.5)  # fmt: skip
ABSENCE = Absence(rate=5.0, blind=0.05)
ELSEWHERE = Elsewhere(level=0.1, growth=0.05, height=0.03)
WITHIN = Within(level=0.25)
"""Where the search begins, and to which little evidence is drawn"""
SHARES = {
    *(("rates", name) for name in ("kept", "entered", "went_on", "astray", "work_removed", "work_moved")),
    *(("rates", name) for name in ("missed", "vanished", "slipped")),
    ("absence", "blind"),
}  # fmt: skip
"""Values that are probabilities"""
_PRIOR = 1.5  # 1, standard deviation of the logarithm (or logit) of each value around its start
_MOMENTS = 5.0  # moments of one object that say as much as one; every other one is judged
_STEPS = (1.0, 0.5)  # of the logarithm (or logit), one pass over all values with each


Key = tuple[str, str]
"""Group and name of a value"""
Vector = dict[Key, float]


def start_of(noise: WorldParameters) -> Vector:
    """Logarithms and logits of the values of some parameters, noise left out."""
    groups = {"rates": noise.rates, "absence": noise.absence, "elsewhere": noise.elsewhere, "within": noise.within}
    return {
        (group, name): _squeezed((group, name), value)
        for group, struct in groups.items()
        for name, value in msgspec.structs.asdict(struct).items()
    }


def with_values(parameters: WorldParameters, vector: Vector) -> WorldParameters:
    """The parameters with values of a vector."""
    groups: dict[str, dict[str, float]] = {}
    for key, value in vector.items():
        groups.setdefault(key[0], {})[key[1]] = _stretched(key, value)
    changed = {name: msgspec.structs.replace(getattr(parameters, name), **values) for name, values in groups.items()}
    return msgspec.structs.replace(parameters, **changed)


def cost_of(episodes: Sequence[Episode], parameters: WorldParameters) -> float:
    """Minus the log likelihood of the truth of what is not seen, nats, neighbours in time counted as one."""
    scores = [log_scores(episode, parameters) for episode in episodes]
    return float(sum(score.sum() for score in scores)) / _MOMENTS


def learn_rates(
    episodes: Sequence[Episode],
    parameters: WorldParameters,
    tell: Callable[[str], None],
    only: Collection[Key] | None = None,
) -> tuple[WorldParameters, Vector]:
    """The most probable values, and the standard errors of their logarithms (or logits).

    Args:
        episodes: to learn by.
        parameters: where the search begins.
        tell: is told how it gets on.
        only: the values that are learned alone; None: all of them.
    """
    first = start_of(parameters)
    if only is not None:
        first = {key: first[key] for key in only}
    vector = dict(first)

    def cost(at: Vector) -> float:
        drawn = 0.5 * sum(((at[key] - first[key]) / _PRIOR) ** 2 for key in at)
        return drawn + cost_of(episodes, with_values(parameters, at))

    best, errors = cost(vector), dict.fromkeys(vector, _PRIOR)
    tell(f"start: {best:.1f} nats")
    for step in _STEPS:
        for key in tuple(vector):
            below, above = (cost({**vector, key: vector[key] + sign * step}) for sign in (-1.0, 1.0))
            curvature = (below + above - 2.0 * best) / step**2
            moves = {-step: below, 0.0: best, step: above}
            if curvature > 0.0:
                errors[key] = min(_PRIOR, curvature**-0.5)
                vertex = float(np.clip(0.5 * (below - above) / (step * curvature), -2.0 * step, 2.0 * step))
                moves[vertex] = cost({**vector, key: vector[key] + vertex})
            move = min(moves, key=lambda shift: moves[shift])
            vector[key], best = vector[key] + move, moves[move]
        tell(f"steps of {step}: {best:.1f} nats")
    return with_values(parameters, vector), errors


def _squeezed(key: Key, value: float) -> float:
    return float(np.log(value / (1.0 - value))) if key in SHARES else float(np.log(value))


def _stretched(key: Key, value: float) -> float:
    return float(1.0 / (1.0 + np.exp(-value))) if key in SHARES else float(np.exp(value))
