"""Whether an expectation holds: one function per check, on the history of a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from agents.scenario.format.events import Kill
from agents.scenario.format.expectations import (
    ActionsCheck,
    ArmsApart,
    Attribute,
    BeliefCloser,
    BeliefError,
    Check,
    Edges,
    Inside,
    NoDrift,
    NoInterpenetration,
    Perceived,
    Recovered,
    Resting,
    RestingHeight,
)
from agents.scenario.judge.cameras import CAMERAS
from agents.scenario.judge.course import COURSE, ready_again, why_missing
from agents.scenario.judge.findings import (
    NOTHING,
    Finding,
    begin_of,
    describe,
    each,
    mm,
    names_of,
    pairs,
    samples_of,
    time_of,
)
from agents.scenario.judge.result import Verdict
from agents.scenario.judge.worlds import WORLDS, edges_in_world
from agents.scenario.truth.history import Error, History, Sample
from agents.scenario.truth.measures import OverlapMeter, belief_gap, drift, height_error, mean_error, pose_error
from dsr.network.keys import BASE
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


def _actions(check: ActionsCheck, history: History, sample: Sample) -> Finding:
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


def _are_as_expected(check: ActionsCheck, found: list[Action]) -> bool:
    if check.sequence is not None:
        patterns = [parse_pattern(term) for term in check.sequence]
        if len(patterns) != len(found):
            return False
        if not all(pattern.fits(action) for pattern, action in zip(patterns, found, strict=True)):
            return False
    present = all(any(parse_pattern(term).fits(action) for action in found) for term in check.present)
    return present and not any(parse_pattern(term).fits(action) for action in found for term in check.absent)


DOINGS: dict[type, Callable[[Any, History, Sample], Finding]] = {Inside: _inside, ActionsCheck: _actions}
"""How each of these checks is judged."""


STILL = 1.0
"""s that a belief must not have moved to count as resting"""
_ROUNDING = 0.5  # s after the end that an expectation may be judged: the run goes on a little


def judge_check(check: Check, history: History) -> Verdict:
    """The verdict on one expectation."""
    text = describe(check)
    time = time_of(check, history)
    if time is None:
        return Verdict(text, False, f"event {check.event} {_stage(check.event, history)}")
    if time > history.end + _ROUNDING:
        return Verdict(text, False, f"the run ended before {time:.1f} s, when it was to be judged")
    sample = history.at(time)
    if sample is None:
        return Verdict(text, False, "no truth was received until then")
    passed, actual = _JUDGES[type(check)](check, history, sample)
    return Verdict(text, passed, actual)


def _stage(number: int | None, history: History) -> str:
    """Why the times that count from an event are not known."""
    why = "" if number is None else why_missing(history, number)
    return why or "has not ended"


def _belief_closer(check: BeliefCloser, history: History, sample: Sample) -> Finding:
    samples = samples_of(check, history)

    def find(name: str) -> Finding:
        seen = [s for s in samples if s.perceived.get(name)]
        percept, belief = mean_error(seen, "percept", name), mean_error(seen, "belief", name)
        if not percept or not belief:
            return False, "no belief" if history.was_perceived(name) else "never seen"
        what = f"belief {mm(belief.position)}, percept {mm(percept.position)}"
        return belief.position < percept.position, what

    return each(check, sample, find)


def _no_interpenetration(check: NoInterpenetration, history: History, sample: Sample) -> Finding:
    names = names_of(check, sample)
    if not names:
        return NOTHING
    if missing := [name for name in names if name not in sample.beliefs]:
        return False, f"no belief of {', '.join(missing)}"
    worst = OverlapMeter(history.scenario, "belief").deepest(samples_of(check, history), names.__contains__)
    if not worst:
        return True, "none"
    return worst.depth <= check.tolerance, f"{mm(worst.depth)} ({worst.first}, {worst.second})"


def _no_drift(check: NoDrift, history: History, sample: Sample) -> Finding:
    samples = samples_of(check, history)

    def find(name: str) -> Finding:
        moved = drift(samples, name)
        return (False, "no belief") if moved is None else (moved <= check.tolerance, mm(moved))

    return each(check, sample, find)


def _resting(check: Resting, history: History, sample: Sample) -> Finding:
    before = history.window(sample.time - STILL, sample.time)

    def find(name: str) -> Finding:
        gap, moved = belief_gap(history.scenario, sample, name), drift(before, name)
        if gap is None or moved is None:
            return False, "no belief"
        resting = abs(gap) <= check.tolerance and moved <= check.tolerance
        return resting, f"gap {mm(gap)}, moved {mm(moved)}"

    return each(check, sample, find)


def _resting_height(check: RestingHeight, history: History, sample: Sample) -> Finding:
    def find(name: str) -> Finding:
        error = height_error(sample, name)
        return (False, "no belief") if error is None else (abs(error) <= check.tolerance, mm(error))

    return each(check, sample, find)


def _belief_error(check: BeliefError, history: History, sample: Sample) -> Finding:
    begin = begin_of(check, history, None)
    samples = [sample] if begin is None else [*history.window(begin, sample.time)]

    def find(name: str) -> Finding:
        counted = [one for one in samples if not check.at_rest or _lies_still(one, name)]
        if not counted:
            return False, "never at rest then"
        if any(name not in one.truth for one in counted):
            return False, "not in the true world"
        errors = [pose_error(one, "belief", name) for one in counted]
        known = [error for error in errors if error]
        right = sum(_is_near(check, error) for error in known) / len(counted)
        if len(known) < len(counted) and right < check.share:
            return False, "no belief" if check.share == 1.0 else f"right {right:.1%} of the time, partly no belief"
        found = mm(max(error.position for error in known))
        if check.angle is not None:
            found += f", {math.degrees(max(error.rotation for error in known)):.2f} deg"
        return right >= check.share, found if check.share == 1.0 else f"right {right:.1%} of the time, at most {found}"

    return each(check, sample, find)


def _lies_still(sample: Sample, name: str) -> bool:
    """Whether the true object is there, does not move, and nobody holds it."""
    return name in sample.truth and name not in sample.moving | sample.grasped.keys() | sample.gripped


def _is_near(check: BeliefError, error: Error) -> bool:
    return error.position <= check.tolerance and (check.angle is None or error.rotation <= check.angle)


def _perceived(check: Perceived, history: History, sample: Sample) -> Finding:
    def find(name: str) -> Finding:
        perceived = sample.perceived.get(name)
        return perceived is check.value, "no node" if perceived is None else str(perceived).lower()

    return each(check, sample, find)


def _attribute(check: Attribute, history: History, sample: Sample) -> Finding:
    found = sample.attributes.get((check.node, check.name))
    if found is None:
        return False, "not set"
    if isinstance(check.value, str | bool) or isinstance(found, bool) or not isinstance(found, int | float):
        return type(found) is type(check.value) and found == check.value, str(found)
    return abs(found - check.value) <= check.tolerance, str(found)


def _edges(check: Edges, history: History, sample: Sample) -> Finding:
    if check.world != BASE:
        return edges_in_world(check, history, sample)
    begin = begin_of(check, history, None)
    for one in [sample] if begin is None else history.window(begin, sample.time):
        found = {(src, dst) for kind, src, dst in one.edges if kind == check.type}
        if not (found.issuperset(check.present) and found.isdisjoint(check.absent)):
            return False, pairs(found) if begin is None else f"{pairs(found)} at {one.time:.2f} s"
    return True, pairs((src, dst) for kind, src, dst in sample.edges if kind == check.type)


def _arms_apart(check: ArmsApart, history: History, sample: Sample) -> Finding:
    measured = [(one.apart, one.time) for one in history.window(check.after, sample.time) if one.apart is not None]
    if not measured:
        return True, "never near one another"
    least, time = min(measured)
    return least >= check.least, f"{mm(least)} at {time:.2f} s"


def _recovered(check: Recovered, history: History, sample: Sample) -> Finding:
    numbered = enumerate(history.scenario.events, start=1)
    kills = [number for number, event in numbered if isinstance(event, Kill) and event.agent == check.agent]
    if missing := [number for number in kills if number not in history.kills]:
        return False, f"event {missing[0]} (kill) has not begun"
    worst = max((ready_again(history, number) for number in kills), default=math.inf)
    return worst <= check.within, f"ready after {worst:.1f} s" if worst < math.inf else "not ready again"


_JUDGES: dict[type, Callable[[Any, History, Sample], Finding]] = {
    BeliefCloser: _belief_closer,
    NoInterpenetration: _no_interpenetration,
    NoDrift: _no_drift,
    Resting: _resting,
    RestingHeight: _resting_height,
    BeliefError: _belief_error,
    Perceived: _perceived,
    Attribute: _attribute,
    Edges: _edges,
    Recovered: _recovered,
    ArmsApart: _arms_apart,
    **WORLDS,
    **COURSE,
    **DOINGS,
    **CAMERAS,
}
