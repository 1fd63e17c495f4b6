"""What the systematic errors of depth of some objects tell of that of another one, though some rest not as believed."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

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


class KnownErrors:
    """The systematic errors of all objects that tell one, in ascending order.

    Args:
        shared: m, as of `error_of_another`.
    """

    def __init__(self, shared: float) -> None:
        self._shared = shared
        self._of: dict[str, KnownError] = {}
        self._ordered: list[KnownError] = []

    def note(self, name: str, error: KnownError | None) -> None:
        """Take in the error of an object; None if it tells none any more."""
        before = self._of.pop(name, None)
        if before is not None:
            del self._ordered[bisect_left(self._ordered, before)]
        if error is not None:
            self._of[name] = error
            insort(self._ordered, error)

    def of_another(self, name: str) -> ErrorOfAnother:
        """The error of an object by those of all others."""
        others, own = self._ordered, self._of.get(name)
        if own is not None:
            place = bisect_left(others, own)
            others = others[:place] + others[place + 1 :]
        return error_of_another(others, self._shared)


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
    metres = _likeliest_set(ordered, shared)
    own = (OWN_ERROR**2 + float(((metres - metres.mean()) ** 2).sum())) / len(metres)
    left = 1.0 / (1.0 / shared**2 + len(metres) / own)
    return ErrorOfAnother(left * float(metres.sum()) / own, math.sqrt(left + own), float(len(metres)))


def _likeliest_set(ordered: Sequence[KnownError], shared: float) -> NDArray[np.float64]:
    """The errors (m) of the objects that rest as believed, of all in ascending order.

    Errors of a set follow each other: another one of as many is no likelier. What may not lean is in each set. Sets of
    so few that they would be less likely than the whole, even if all their errors were 0, are not looked at.
    """
    count = len(ordered)
    resting = [i for i, error in enumerate(ordered) if not error.may_lean]
    first, end = (resting[0], resting[-1] + 1) if resting else (count - 1, 1)
    metres = np.array([error.metres for error in ordered])
    if (first, end) == (0, count):
        return metres
    sums, sums_of_squares = np.cumsum([np.r_[0.0, metres], np.r_[0.0, metres**2]], axis=1)
    most = _most_evidence(count, shared)

    def evidence(counts: NDArray[np.int_], begins: NDArray[np.int_]) -> NDArray[np.float64]:
        """Of sets of so many errors from those places on, as of `_most_evidence`."""
        ends = begins + counts
        means = (sums[ends] - sums[begins]) / counts
        squares = np.maximum(sums_of_squares[ends] - sums_of_squares[begins] - counts * means**2, 0.0)
        return np.asarray(most[counts] - 0.5 * (counts * np.log1p(squares / OWN_ERROR**2) + (means / shared) ** 2))

    fewest = int(np.argmax(most >= evidence(np.array([count]), np.array([0]))))
    first, end = min(first, count - fewest), max(end, fewest)
    begins = np.arange(first + 1)[:, None]
    counts = np.maximum(np.arange(end, count + 1) - begins, 1)
    begin, column = divmod(int(np.argmax(evidence(counts, begins))), counts.shape[1])
    return metres[begin : begin + counts[begin, column]]


@lru_cache(maxsize=256)
def _most_evidence(known: int, shared: float) -> NDArray[np.float64]:
    """Logarithm of how probable `known` errors are if those of a set alone rest as believed, and all in it are 0.

    Of sets of 0, 1, 2, ... errors (known + 1,); none is empty.
    """
    counts = np.arange(1, known + 1)
    anywhere = nats.LEANS + math.log(2.0 * LIKELY_SIGMAS * shared)
    density: NDArray[np.float64] = (
        gammaln(0.5 * counts) - math.lgamma(0.5)
        - 0.5 * (counts - 1) * math.log(math.pi * OWN_ERROR**2) - 0.5 * np.log(counts)
        - math.log(math.sqrt(2.0 * math.pi) * shared) - anywhere * (known - counts)
    )  # fmt: skip
    return np.concatenate([[-np.inf], density])
