"""Asks the belief's simulator whether a thing would stay where it is to be put."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator

from dsr.errors import TransportError
from dsr.math3d.transforms import Pose
from dsr.vocabulary.what_if import Answer, Pending, Question, Supposed, WhatIf
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

    def trouble(self, thing: str, pose: Pose) -> Generator[None, None, str]:
        """Ask what would go wrong if `thing` were put at `pose` (world_from_thing), in words: empty if it stays, or
        nobody knows.
        """
        if self._config.what_if_patience <= 0.0:
            return ""
        try:
            pending = self._what_if.ask(Question(self._config.what_if_seconds, (Supposed.place(thing, pose),)))
        except TransportError as error:
            return self._unknown(str(error))
        began = self._now()
        while not pending.done and self._now() - began < self._config.what_if_patience:
            yield
        return self._unknown(_reason(pending)) if pending.answer is None else _movement(pending.answer, self._config)

    def _unknown(self, reason: str) -> str:
        if not self._complained:
            self._log.warning("going on without knowing what would topple: %s (logged once)", reason)
        self._complained = True
        return ""


def _reason(pending: Pending) -> str:
    return pending.failed or "no answer yet"


def _movement(answer: Answer, config: PlannerConfig) -> str:
    worst = max(answer.moved, key=lambda name: (answer.moved[name], name), default="")
    most = max(answer.turned, key=lambda name: (answer.turned[name], name), default="")
    if worst and answer.moved[worst] > config.what_if_shift:
        return f"{worst} would move by {answer.moved[worst] * 1e3:.0f} mm"
    if most and answer.turned[most] > config.what_if_turn:
        return f"{most} would turn by {answer.turned[most]:.1f} rad"
    return ""
