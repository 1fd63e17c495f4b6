"""Whether an expectation holds: one function per check, on the history of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from agents.scenario.events import Kill
from agents.scenario.expectations import (
    Attribute,
    BeliefCloser,
    BeliefError,
    Check,
    Edges,
    Expectation,
    NoDrift,
    NoInterpenetration,
    OfObjects,
    Perceived,
    Recovered,
    Resting,
    RestingHeight,
    Windowed,
)
from agents.scenario.history import History, Sample
from agents.scenario.measures import OverlapMeter, belief_gap, drift, height_error, mean_error, pose_error
from agents.scenario.result import Verdict

STILL = 1.0
"""s that a belief must not have moved to count as resting"""
Finding = tuple[bool, str]
"""Whether it holds, and what was found."""
_NOTHING: Finding = (False, "there was no object to judge")


def judge_check(check: Check, history: History) -> Verdict:
    """The verdict on one expectation."""
    sample = history.at(_time(check, history))
    text = describe(check)
    if sample is None:
        return Verdict(text, False, "no truth was received until then")
    passed, actual = _JUDGES[type(check)](check, history, sample)
    return Verdict(text, passed, actual)


def describe(check: Check) -> str:
    """The expectation in a line, e.g. `resting (tolerance 1 mm)`."""
    details = [f"{key} {_written(key, value)}" for key, value in _stated(check) if value not in (None, ())]
    name = str(check.__struct_config__.tag)
    return f"{name} ({', '.join(details)})" if details else name


def _stated(check: Check) -> Iterable[tuple[str, Any]]:
    return ((field, getattr(check, field)) for field in check.__struct_fields__)


def _written(key: str, value: Any) -> str:
    if key in ("at", "after", "within"):
        return f"{value:g} s"
    if key == "tolerance":
        return _mm(value)
    if key == "angle":
        return f"{math.degrees(value):g} deg"
    if isinstance(value, tuple):
        return ", ".join(" -> ".join(item) if isinstance(item, tuple) else str(item) for item in value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _time(check: Expectation, history: History) -> float:
    return history.scenario.duration if check.at is None else check.at


def _samples(check: Windowed, history: History) -> Sequence[Sample]:
    begin = history.scenario.settle if check.after is None else check.after
    return history.window(begin, _time(check, history))


def _each(check: OfObjects, sample: Sample, find: Callable[[str], Finding]) -> Finding:
    """The findings about all objects of the check, the failed ones first; without any object it does not hold."""
    names = list(sample.truth) if check.objects is None else check.objects
    if not names:
        return _NOTHING
    findings = sorted(((name, *find(name)) for name in names), key=lambda finding: finding[1])
    return all(ok for _, ok, _ in findings), "; ".join(f"{name}: {what}" for name, _, what in findings)


def _belief_closer(check: BeliefCloser, history: History, sample: Sample) -> Finding:
    samples = _samples(check, history)

    def find(name: str) -> Finding:
        seen = [s for s in samples if s.perceived.get(name)]
        percept, belief = mean_error(seen, "percept", name), mean_error(seen, "belief", name)
        if not percept or not belief:
            return False, "no belief" if history.was_perceived(name) else "never seen"
        what = f"belief {_mm(belief.position)}, percept {_mm(percept.position)}"
        return belief.position < percept.position, what

    return _each(check, sample, find)


def _no_interpenetration(check: NoInterpenetration, history: History, sample: Sample) -> Finding:
    names = list(sample.truth) if check.objects is None else check.objects
    if not names:
        return _NOTHING
    if missing := [name for name in names if name not in sample.beliefs]:
        return False, f"no belief of {', '.join(missing)}"
    worst = OverlapMeter(history.scenario, "belief").deepest(_samples(check, history), names.__contains__)
    if not worst:
        return True, "none"
    return worst.depth <= check.tolerance, f"{_mm(worst.depth)} ({worst.first}, {worst.second})"


def _no_drift(check: NoDrift, history: History, sample: Sample) -> Finding:
    samples = _samples(check, history)

    def find(name: str) -> Finding:
        moved = drift(samples, name)
        return (False, "no belief") if moved is None else (moved <= check.tolerance, _mm(moved))

    return _each(check, sample, find)


def _resting(check: Resting, history: History, sample: Sample) -> Finding:
    before = history.window(sample.time - STILL, sample.time)

    def find(name: str) -> Finding:
        gap, moved = belief_gap(history.scenario, sample, name), drift(before, name)
        if gap is None or moved is None:
            return False, "no belief"
        resting = abs(gap) <= check.tolerance and moved <= check.tolerance
        return resting, f"gap {_mm(gap)}, moved {_mm(moved)}"

    return _each(check, sample, find)


def _resting_height(check: RestingHeight, history: History, sample: Sample) -> Finding:
    def find(name: str) -> Finding:
        error = height_error(sample, name)
        return (False, "no belief") if error is None else (abs(error) <= check.tolerance, _mm(error))

    return _each(check, sample, find)


def _belief_error(check: BeliefError, history: History, sample: Sample) -> Finding:
    def find(name: str) -> Finding:
        error = pose_error(sample, "belief", name)
        if error is None:
            return False, "no belief" if name in sample.truth else "not in the true world"
        near = error.position <= check.tolerance
        if check.angle is None:
            return near, _mm(error.position)
        turned = f"{math.degrees(error.rotation):.2f} deg"
        return near and error.rotation <= check.angle, f"{_mm(error.position)}, {turned}"

    return _each(check, sample, find)


def _perceived(check: Perceived, history: History, sample: Sample) -> Finding:
    def find(name: str) -> Finding:
        perceived = sample.perceived.get(name)
        return perceived is check.value, "no node" if perceived is None else str(perceived).lower()

    return _each(check, sample, find)


def _attribute(check: Attribute, history: History, sample: Sample) -> Finding:
    found = sample.attributes.get((check.node, check.name))
    if found is None:
        return False, "not set"
    if isinstance(check.value, str | bool) or isinstance(found, bool) or not isinstance(found, int | float):
        return type(found) is type(check.value) and found == check.value, str(found)
    return abs(found - check.value) <= check.tolerance, str(found)


def _edges(check: Edges, history: History, sample: Sample) -> Finding:
    found = {(src, dst) for kind, src, dst in sample.edges if kind == check.type}
    passed = found.issuperset(check.present) and found.isdisjoint(check.absent)
    return passed, ", ".join(f"{src} -> {dst}" for src, dst in sorted(found)) or "none"


def _recovered(check: Recovered, history: History, sample: Sample) -> Finding:
    kills = [event for event in history.scenario.events if isinstance(event, Kill)]
    killed = [(event.at or 0.0) + event.delay for event in kills if event.agent == check.agent]
    starts = [time for time, agent in history.agent_starts if agent == check.agent]
    after = [min((start - kill for start in starts if start > kill), default=math.inf) for kill in killed]
    worst = max(after, default=math.inf)
    return worst <= check.within, f"ready after {worst:.1f} s" if worst < math.inf else "not ready again"


def _mm(metres: float) -> str:
    return f"{metres * 1000:.2f} mm"


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
}
