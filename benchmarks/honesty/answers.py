"""Scores of what is said to be so with a probability: relations, holders and actions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

BINS = 10
"""Classes of probability of a calibration curve, of equal width"""


class Answer(NamedTuple):
    """A probability that was told, and the truth."""

    probability: float
    is_so: bool
    time: float = 0.0
    """s after the start"""
    about: tuple[str, str] = ("", "")
    """The pair of a relation, as in its edge; of an action its kind and its thing"""


class Class(NamedTuple):
    """The answers of about one probability."""

    told: float
    """Their mean probability."""
    is_so: float
    """Share of them that is so."""
    size: int


def brier(answers: Iterable[Answer], questions: int) -> float:
    """The Brier score: the sum of squared errors of the probabilities over the number of questions. Less is better.

    Pairs that nobody told and that are not so cost nothing. So questions count things, not pairs.
    """
    return sum((answer.probability - answer.is_so) ** 2 for answer in answers) / questions


def calibration(answers: Sequence[Answer]) -> list[Class]:
    """How often is so what is told with about one probability, by increasing probability."""
    classes: dict[int, list[Answer]] = {}
    for answer in answers:
        classes.setdefault(min(int(answer.probability * BINS), BINS - 1), []).append(answer)
    return [
        Class(
            sum(answer.probability for answer in found) / len(found),
            sum(answer.is_so for answer in found) / len(found),
            len(found),
        )
        for _, found in sorted(classes.items())
    ]


SURE = 0.9
"""Probability from which on what is told is sure"""


def sure_and_wrong(answers: Iterable[Answer]) -> float | None:
    """Share of the sure answers that are wrong; None without any."""
    found = [answer for answer in answers if answer.probability >= SURE]
    return sum(not answer.is_so for answer in found) / len(found) if found else None
