"""Asks the belief's simulator whether a thing would stay where it is to be put."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Generator

from dsr.errors import TransportError
from dsr.math3d.transforms import Pose
from dsr.perception.scales import STANDING
from dsr.vocabulary.sentences import percent
from dsr.vocabulary.what_if import Pending, Question, Supposed, WhatIf, WorldOutcome, share
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

        The question is tried in several worlds of the belief. Empty if nothing goes wrong in worlds of a probability
        of 1 - `most` at least, or nobody knows. In a world in which there is no room, the place is bad.
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
        outcomes = pending.refusals if pending.answer is None else pending.answer.outcomes
        return _verdict(outcomes, config, most) if outcomes else self._unknown(_reason(pending))

    def _unknown(self, reason: str) -> str:
        if not self._complained:
            self._log.warning("going on without knowing what would topple: %s (logged once)", reason)
        self._complained = True
        return ""


def _reason(pending: Pending) -> str:
    return pending.failed or "no answer yet"


def _verdict(outcomes: Collection[WorldOutcome], config: PlannerConfig, most: float) -> str:
    """What goes wrong in the most probable of the worlds where something does, if these are more than `most`."""
    problems = [(outcome.weight, problem) for outcome in outcomes if (problem := _problem(outcome, config))]
    probability = share(outcomes, lambda outcome: bool(_problem(outcome, config)))
    if probability <= most:
        return ""
    _, problem = max(problems, key=lambda pair: pair[0])
    return problem if len(problems) == len(outcomes) else f"{problem} ({percent(probability)} probable)"


def _problem(outcome: WorldOutcome, config: PlannerConfig) -> str:
    """What goes wrong in a world by putting the thing there, in words; empty if nothing does.

    What moves anyway counts only as far as it moves otherwise.
    """
    if outcome.refused:
        return outcome.refused
    effects = {name: outcome.effect(name) for name in outcome.moved}
    worst = max(effects, key=lambda name: (effects[name][0], name), default="")
    most = max(effects, key=lambda name: (effects[name][1], name), default="")
    if worst and effects[worst][0] > config.still:
        return f"{worst} would move by {effects[worst][0] * 1e3:.0f} mm"
    if most and effects[most][1] > STANDING:
        return f"{most} would turn by {effects[most][1]:.1f} rad"
    return ""
