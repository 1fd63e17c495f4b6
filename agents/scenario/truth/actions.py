"""Derives the true actions of hands and gripper from holders and motions, and compares them with the inferred ones."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec

from agents.scenario.format.events import PlaceEvent, Remove, Swap
from agents.scenario.truth.history import History, Inferred, Sample
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, Action

LIFTED = 0.010
"""m that a thing must rise while it is held to have been picked"""
LEFT = 0.002
"""m of that, from which it has left where it lay"""
FALLEN = 0.015
"""m that a thing must come down after it was let go to have been released rather than placed"""
AT_REST = 0.005
"""m within which a thing stays between touching down and being let go"""
AFTERWARDS = 1.0
"""s after it was let go in which it must come down for that"""
EARLY, LATE = 0.5, 3.0
"""s before and after a true action between which an inferred one is of it, by the time that it tells"""


class Match(msgspec.Struct, frozen=True):
    """A true action, and the action inferred for it."""

    true: Action
    inferred: Inferred | None


class ActionComparison(msgspec.Struct, frozen=True):
    """All true actions, and the actions inferred beyond them."""

    matches: list[Match]
    extra: list[Inferred]


def true_actions(history: History) -> list[Action]:
    """In order of time, s after the start. What only comes along with what is held has nothing done to it."""
    return sorted(action for spec in history.scenario.objects for action in _actions_of(spec.name, history.samples))


def compare(history: History) -> ActionComparison:
    """Pair true and inferred actions of the same kind and thing, each with the nearest in time.

    Actions around teleports (events `place`, `swap` and `remove`) do not count: nothing happens there that could be
    inferred rightly or wrongly.
    """
    true = [action for action in true_actions(history) if not _is_excused(action, history)]
    left = [inferred for inferred in history.actions if not _is_excused(inferred.action, history)]
    pairs = sorted(
        (abs(inferred.action.time - action.time), number, index)
        for number, action in enumerate(true)
        for index, inferred in enumerate(left)
        if inferred.action[1:3] == action[1:3] and -EARLY <= inferred.action.time - action.time <= LATE
    )
    found: dict[int, int] = {}
    for _, number, index in pairs:
        if number not in found and index not in found.values():
            found[number] = index
    matches = [Match(action, left[found[number]] if number in found else None) for number, action in enumerate(true)]
    return ActionComparison(matches, [left[index] for index in sorted(set(range(len(left))) - set(found.values()))])


def _is_excused(action: Action, history: History) -> bool:
    for number, event in enumerate(history.scenario.events, start=1):
        if isinstance(event, PlaceEvent | Swap | Remove) and action.thing in event.named_objects.values():
            begin, end = history.spans.get(number, (float("inf"), None))
            if begin - EARLY <= action.time <= (begin if end is None else end) + LATE:
                return True
    return False


def _actions_of(name: str, samples: Sequence[Sample]) -> list[Action]:
    present = [sample for sample in samples if name in sample.truth]
    actions = []
    begin = 0
    for end, (before, sample) in enumerate(pairwise(present), start=1):
        if name in before.grasped and name not in sample.grasped:
            actions += _of_one_grip(name, present[begin:end], present[end:])
        if name not in before.grasped and name in sample.grasped:
            begin = end - 1
    if present and name in present[-1].grasped:
        actions += _of_one_grip(name, present[begin:], [])
    return actions


def _of_one_grip(name: str, held: Sequence[Sample], after: Sequence[Sample]) -> list[Action]:
    """From the last moment before it was grasped; `after` begins when it had been let go."""
    lay = _height(held[0], name)
    top = next((k for k, sample in enumerate(held) if _height(sample, name) - lay > LIFTED), None)
    if top is None:
        return []
    left = next(sample for sample in held if _height(sample, name) - lay > LEFT)
    by = held[top].grasped.get(name) or held[-1].grasped[name]
    actions = [Action(left.time, PICK, name, by)]
    if after:
        last = held[-1]
        soon = [sample for sample in after if sample.time <= last.time + AFTERWARDS]
        if any(_height(last, name) - _height(sample, name) > FALLEN for sample in soon):
            actions.append(Action(last.time, RELEASE, name, last.grasped[name]))
        else:
            actions.append(Action(_touched_down(name, held), PLACE, name, last.grasped[name]))
    return actions


def _touched_down(name: str, held: Sequence[Sample]) -> float:
    """Since when it has stayed where it was let go, s."""
    end = held[-1].truth[name]
    moved = [k for k, sample in enumerate(held) if sample.truth[name].distance(end)[0] > AT_REST]
    return held[moved[-1] + 1].time if moved else held[0].time


def _height(sample: Sample, name: str) -> float:
    """World z of its centre, m."""
    return sample.truth[name].t[2]
