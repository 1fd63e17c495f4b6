"""Expectations about what hands and containers do: inferred actions, and what is inside of what."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agents.scenario.expectations import Actions, Inside
from agents.scenario.findings import Finding, begin_of, pairs
from agents.scenario.history import History, Sample
from dsr.vocabulary.observed_actions import Action, parse_pattern

_SLACK = 1e-6  # s


def _inside(check: Inside, history: History, sample: Sample) -> Finding:
    begin = begin_of(check, history, None)
    for one in [sample] if begin is None else history.window(begin, sample.time):
        found = _pairs_in(one)
        if not (found.issuperset(check.present) and found.isdisjoint(check.absent)):
            return False, pairs(found) if begin is None else f"{pairs(found)} at {one.time:.2f} s"
    return True, pairs(_pairs_in(sample))


def _pairs_in(sample: Sample) -> set[tuple[str, str]]:
    return {(src, dst) for kind, src, dst in sample.edges if kind == "in"}


def _actions(check: Actions, history: History, sample: Sample) -> Finding:
    begin = begin_of(check, history, 0.0) or 0.0
    names = {spec.name for spec in history.scenario.objects} if check.objects is None else set(check.objects)
    found = sorted(
        inferred.action
        for inferred in history.actions
        if inferred.noticed <= sample.time + _SLACK and inferred.action.time >= begin - _SLACK
        if inferred.action.thing in names
    )
    text = ", ".join(f"{action} at {action.time:.2f} s" for action in found) or "none"
    return _are_as_expected(check, found), text


def _are_as_expected(check: Actions, found: list[Action]) -> bool:
    if check.sequence is not None:
        patterns = [parse_pattern(term) for term in check.sequence]
        if len(patterns) != len(found):
            return False
        if not all(pattern.fits(action) for pattern, action in zip(patterns, found, strict=True)):
            return False
    present = all(any(parse_pattern(term).fits(action) for action in found) for term in check.present)
    return present and not any(parse_pattern(term).fits(action) for action in found for term in check.absent)


DOINGS: dict[type, Callable[[Any, History, Sample], Finding]] = {Inside: _inside, Actions: _actions}
"""How each of these checks is judged."""
