"""Asks the belief's simulator whether a thing would stay where it is to be put."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator

from dsr.errors import TransportError
from dsr.math3d.transforms import Pose
from dsr.vocabulary.sentences import percent
from dsr.vocabulary.what_if import Answer, Pending, Question, Supposed, WhatIf, WorldOutcome
from planner.config import PlannerConfig


class Foresight:
    """Puts questions to the what-if service.

    Args:
        what_if: asks.
        config: how long to wait for an answer, and how far things may move.
        now: gives the time, s.
        log: says once when there is no answer.
    """

    def __init__(self, what_if: WhatIf, config: PlannerConfig, now: Callable[[], float], log: logging.Logger) -> None:
        self._what_if = what_if
        self._config = config
        self._now = now
        self._log = log
        self._complained = False

    def trouble(self, thing: str, pose: Pose, most: float) -> Generator[None, None, str]:
        """Ask what would go wrong if `thing` were put at `pose` (world_from_thing), in words; it waits at each yield.

        The question is tried in several worlds of the belief. Empty if all stays in worlds of a probability of
        1 - `most` at least, or nobody knows.
        """
        if self._config.what_if_patience <= 0.0:
            return ""
        config, change = self._config, Supposed.place(thing, pose)
        try:
            pending = self._what_if.ask(Question(config.what_if_seconds, (change,), worlds=config.what_if_worlds))
        except TransportError as error:
            return self._unknown(str(error))
        began = self._now()
        while not pending.done and self._now() - began < config.what_if_patience:
            yield
        return self._unknown(_reason(pending)) if pending.answer is None else _verdict(pending.answer, config, most)

    def _unknown(self, reason: str) -> str:
        if not self._complained:
            self._log.warning("going on without knowing what would topple: %s (logged once)", reason)
        self._complained = True
        return ""


def _reason(pending: Pending) -> str:
    return pending.failed or "no answer yet"


def _verdict(answer: Answer, config: PlannerConfig, most: float) -> str:
    """What goes wrong in the most probable of the worlds where something does, if these are more than `most`."""
    problems = [(outcome.weight, problem) for outcome in answer.outcomes if (problem := _problem(outcome, config))]
    probability = answer.probability(lambda outcome: bool(_problem(outcome, config)))
    if probability <= most:
        return ""
    _, problem = max(problems, key=lambda pair: pair[0])
    return problem if len(problems) == len(answer.outcomes) else f"{problem} ({percent(probability)} probable)"


def _problem(outcome: WorldOutcome, config: PlannerConfig) -> str:
    """What goes wrong in a world, in words; empty if all stays."""
    if outcome.refused:
        return outcome.refused
    worst = max(outcome.moved, key=lambda name: (outcome.moved[name], name), default="")
    most = max(outcome.turned, key=lambda name: (outcome.turned[name], name), default="")
    if worst and outcome.moved[worst] > config.what_if_shift:
        return f"{worst} would move by {outcome.moved[worst] * 1e3:.0f} mm"
    if most and outcome.turned[most] > config.what_if_turn:
        return f"{most} would turn by {outcome.turned[most]:.1f} rad"
    return ""
