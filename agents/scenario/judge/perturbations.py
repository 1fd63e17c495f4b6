"""Perturbations of a run: the experimenter's changes, their ends, and the recovery of the belief."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from agents.scenario.truth.history import Explained, History, Sample
from agents.scenario.truth.relations import true_relations
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose

UNDISTURBED = PoseTolerance(0.002, 0.05)
"""m, rad that a true object may move without counting as moved"""
WRONG = 0.020
"""m from the truth, from where on a belief is wrong rather than inexact"""
AFTER_EXPLANATION = 0.3
"""s after an explanation was adopted, when what is then believed is judged: relations follow contact with a delay"""

_TAKING = 0.5  # s from when a gripper first moves an object until it holds it


class Perturbation(msgspec.Struct, frozen=True):
    """Events of the experimenter that overlap in time."""

    events: tuple[int, ...]
    """Their numbers in the file, from 1."""
    begin: float
    """s after the start"""
    end: float
    """s after the start, when all objects lay still again and were to be seen; infinite if they never did"""
    until: float
    """s after the start: the next perturbation or the end"""


class Recovery(msgspec.Struct, frozen=True):
    """The recovery of the belief after a perturbation."""

    seconds: float
    """s from its end until all beliefs stayed close; infinite if one did not"""
    last: str
    """Name of the object that took longest; empty without objects."""
    error: float
    """m of that object when it was last too far away; infinite without a belief"""


def perturbations(history: History) -> list[Perturbation]:
    """List the perturbations of a run in order of time; those that overlap are one."""
    end_of_run = history.end
    groups: list[tuple[list[int], float, float]] = []
    for number, (begin, end) in sorted(history.spans.items(), key=lambda item: item[1][0]):
        last = math.inf if end is None else end
        if groups and begin <= groups[-1][2]:
            numbers, first, latest = groups[-1]
            groups[-1] = ([*numbers, number], first, max(latest, last))
        else:
            groups.append(([number], begin, last))
    nexts = [*(begin for _, begin, _ in groups), end_of_run][1:]
    found = []
    for (numbers, begin, end), until in zip(groups, nexts, strict=True):
        over = None if end == math.inf else clear_from(history, begin, end, until)
        found.append(Perturbation(tuple(numbers), begin, math.inf if over is None else over, until))
    return found


def event_end(history: History, number: int) -> float | None:
    """Time (s after the start) when an event (numbered from 1) was over, as `clear_from` says; None if it was not."""
    begin, end = history.spans.get(number, (0.0, None))
    return None if end is None or number in history.given_up else clear_from(history, begin, end, math.inf)


def clear_from(history: History, begin: float, end: float, until: float) -> float | None:
    """When what happened between `begin` and `end` (s) was over, and to be seen; None if never before `until`.

    What it moved lies still, and what of that nothing stands on has come into the camera's view since: the arm may
    have been in front of it. What never does, like a tag on its side, is not waited for; nor is what the arm moves.
    """
    samples = [sample for sample in history.after(end) if sample.time <= until]
    if not samples:
        return None
    first, before = samples[0], history.before(begin) or history.samples[0]
    disturbed = {name for name, pose in first.truth.items() if not _stays(before.truth.get(name), pose)}
    taken = {name for sample in samples if sample.time <= end + _TAKING for name in sample.gripped}  # as grippers close
    disturbed = (disturbed | (first.moving - taken)) - before.gripped - first.gripped
    still = next(
        (
            earlier
            for earlier, later in pairwise(samples)
            if not (earlier.moving | later.moving) & disturbed - earlier.gripped - later.gripped
        ),
        None,
    )
    if still is None:
        return None
    covered = {lower for _, lower in true_relations(history.scenario, still.truth)}
    open_ones = disturbed - covered - still.gripped
    seen = (next((one.time for one in samples if name in one.in_view), still.time) for name in open_ones)
    return max((still.time, *seen))


def recovery(history: History, after: Perturbation, tolerance: float, names: Sequence[str] | None = None) -> Recovery:
    """How long it took from the end of a perturbation until all beliefs stayed within `tolerance` m of the truth.

    Each object is looked at until it truly moves again, is taken by the gripper, or the next perturbation begins.
    One that was removed must have no belief.
    """
    samples = history.window(after.end, after.until) if after.end < after.until else []
    if not samples:
        return Recovery(math.inf, "", math.inf)
    known = {spec.name for spec in history.scenario.objects} if names is None else set(names)
    worst = Recovery(0.0, "", 0.0)
    for name in sorted(known):
        errors = _errors(samples, name)
        bad = [index for index, (_, error) in enumerate(errors) if error > tolerance]
        if bad:
            is_last = bad[-1] == len(errors) - 1
            seconds = math.inf if is_last else errors[bad[-1] + 1][0] - after.end
            if seconds > worst.seconds:
                worst = Recovery(seconds, name, errors[bad[-1]][1])
    return worst


def unjudged(after: Perturbation, found: Recovery) -> str:
    """Why no belief could be judged after a perturbation; empty if one was."""
    judged = after.end < math.inf and (found.last or found.seconds < math.inf)
    return "" if judged else "things did not lie still before the next one or the end"


def recovery_in_view(history: History, after: Perturbation, tolerance: float) -> float:
    """How long it took (s) from when what is wrongly believed could be seen until that stayed within `tolerance` m.

    What stands under something is seen by what is on top; what never comes into view counts from the end of the
    perturbation. 0 if nothing was wrong, infinite if something stayed so.
    """
    samples = history.window(after.end, after.until) if after.end < after.until else []
    worst = 0.0
    names = {spec.name for spec in history.scenario.objects} if samples else ()
    wrong = {name: bad for name in names if (bad := _wrong_at(samples, name, tolerance))}
    relations = true_relations(history.scenario, samples[0].truth, samples[0].gripped) if wrong else frozenset()
    for name, bad in wrong.items():
        top = _top(name, relations)
        shown = next((sample.time for sample in samples if top in sample.in_view), after.end)
        right = next((time for time, _ in _errors(samples, name) if time > bad[-1]), math.inf)
        worst = max(worst, right - max(shown, after.end))
    return worst


def _wrong_at(samples: Sequence[Sample], name: str, tolerance: float) -> list[float]:
    """When (s) an object that stays where it is was believed further from the truth than `tolerance` m."""
    return [time for time, error in _errors(samples, name) if error > tolerance]


def _top(name: str, relations: frozenset[tuple[str, str]]) -> str:
    """What stands highest on an object; the object itself if nothing does."""
    above = sorted(upper for upper, lower in relations if lower == name)
    return _top(above[0], relations) if above else name


def _errors(samples: Sequence[Sample], name: str) -> list[tuple[float, float]]:
    """Time and error (m) of the belief in an object while it stays where it is."""
    start = samples[0].truth.get(name)
    found = []
    for sample in samples:
        true, belief = sample.truth.get(name), sample.beliefs.get(name)
        if name in sample.gripped or not _stays(start, true):
            break
        if true is None:
            error = 0.0 if belief is None else math.inf
        else:
            error = belief.distance(true)[0] if belief else math.inf
        found.append((sample.time, error))
    return found


def _stays(start: Pose | None, now: Pose | None) -> bool:
    if start is None or now is None:
        return start is now
    return UNDISTURBED.covers(start, now)


def wrong_explanations(history: History) -> list[Explained]:
    """The explanations after whose adoption something was believed wrongly that could have been known.

    Looked at `AFTER_EXPLANATION` later, or just before the next explanation or perturbation if that is sooner:
    an object at rest whose belief is missing or further than `WRONG` from the truth, or relations `on` of such
    objects that are not the true ones.
    """
    found = []
    nexts = [*(explained.time for explained in history.explanations), math.inf][1:]
    begins = [begin for begin, _ in history.spans.values()]
    for explained, following in zip(history.explanations, nexts, strict=True):
        sooner = [time for time in (following, *begins) if time > explained.time]
        sample = history.before(min(explained.time + AFTER_EXPLANATION, *sooner))
        if sample is not None and is_wrong(history, sample):
            found.append(explained)
    return found


def is_wrong(history: History, sample: Sample) -> bool:
    """Whether an object at rest is believed elsewhere, or on something else, than it is."""
    resting = {name for name in sample.truth if name not in sample.moving and name not in sample.gripped}
    for name in resting:
        belief = sample.beliefs.get(name)
        if belief is None or belief.distance(sample.truth[name])[0] > WRONG:
            return True
    if any(name in sample.beliefs for name in {spec.name for spec in history.scenario.objects} - set(sample.truth)):
        return True
    true = true_relations(history.scenario, sample.truth, sample.gripped)
    believed = {(src, dst) for kind, src, dst in sample.edges if kind == "on"}
    return any(_of(true, name) != _of(believed, name) for name in resting)


def _of(relations: frozenset[tuple[str, str]] | set[tuple[str, str]], name: str) -> set[tuple[str, str]]:
    return {pair for pair in relations if pair[0] == name}
