"""What the systematic errors of depth of some objects tell of that of another one, though some rest not as believed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from dsr.perception.scales import LIKELY_SIGMAS
from dsr.vocabulary import nats
from simulation_handler.scales import OWN_ERROR


class KnownError(NamedTuple):
    """The systematic error of an object, if it rests as believed."""

    metres: float
    """m along the viewing ray"""
    may_lean: bool
    """Whether it is beside something on which it may lean: the error is another one then"""


class ErrorOfAnother(NamedTuple):
    """Student's t distribution of a systematic error."""

    mean: float
    """m along the viewing ray"""
    scale: float
    """m"""
    freedom: float
    """1, degrees of freedom; infinite for a Gaussian"""


def error_of_another(known: Iterable[KnownError], shared: float) -> ErrorOfAnother:
    """The systematic error of an object by those of others.

    Each error is a part that all share and one of its own. How large the latter are, the known ones tell, beside
    `OWN_ERROR`, which counts as one of them (normal and inverse chi-squared, Gelman et al., Bayesian Data Analysis,
    3.3). What may lean has any error if it does: of all sets that may rest as believed, the likeliest tells.

    Args:
        known: the errors of the others.
        shared: m, standard deviation of the part that all share.
    """
    ordered = sorted(known)
    if not ordered:
        return ErrorOfAnother(0.0, math.hypot(shared, OWN_ERROR), math.inf)
    sets = [ordered[i:j] for i in range(len(ordered)) for j in range(i + 1, len(ordered) + 1)]  # others are no likelier
    best = max(sets, key=lambda chosen: _log_evidence(chosen, ordered, shared))
    _, mean, squares = _summary(best)
    freedom = len(best)
    own = (OWN_ERROR**2 + squares) / freedom
    left = 1.0 / (1.0 / shared**2 + len(best) / own)
    return ErrorOfAnother(left * len(best) * mean / own, math.sqrt(left + own), freedom)


def _log_evidence(chosen: Sequence[KnownError], known: Sequence[KnownError], shared: float) -> float:
    """Logarithm of how probable all errors are if those of the chosen objects alone rest as believed; -inf if others
    must.
    """
    count, mean, squares = _summary(chosen)
    if sum(error.may_lean for error in chosen) + len(known) - count != sum(error.may_lean for error in known):
        return -math.inf
    prior = OWN_ERROR**2
    anywhere = nats.LEANS + math.log(2.0 * LIKELY_SIGMAS * shared)
    return (
        math.lgamma(0.5 * count) - math.lgamma(0.5)
        + 0.5 * math.log(prior) - 0.5 * count * math.log(prior + squares)
        - 0.5 * (count - 1) * math.log(math.pi) - 0.5 * math.log(count)
        - 0.5 * (mean / shared) ** 2 - math.log(math.sqrt(2.0 * math.pi) * shared)
        - anywhere * (len(known) - count)
    )  # fmt: skip


def _summary(errors: Sequence[KnownError]) -> tuple[int, float, float]:
    """Their count, mean (m), and sum of squares about it (m^2)."""
    mean = sum(error.metres for error in errors) / len(errors)
    return len(errors), mean, sum((error.metres - mean) ** 2 for error in errors)
