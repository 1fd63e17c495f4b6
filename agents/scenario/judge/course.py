"""Expectations about the course of a run: relations, recovery from perturbations, surprise, mission."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from agents.scenario.format.events import Kill
from agents.scenario.format.expectations import (
    BeliefRecovered,
    Gone,
    MissionCheck,
    RelationsRight,
    Replans,
    SurprisesCheck,
    Surprising,
    TrueRelationsCheck,
)
from agents.scenario.judge.findings import Finding, begin_of, each, mm, names_of, pairs
from agents.scenario.judge.overload import counted
from agents.scenario.judge.perturbations import perturbations, recovery, unjudged
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.relations import true_relations


def rises(history: History, begin: float, end: float, names: set[str]) -> list[tuple[float, str]]:
    """List when (s after the start) which of `names` became surprising."""
    window = history.window(begin, end)
    return [
        (later.time, name)
        for earlier, later in pairwise(window)
        for name in sorted((later.surprising - earlier.surprising) & names)
    ]


def missing_events(history: History) -> list[str]:
    """List the events that were to happen and have not, e.g. `event 2 (slide) has not begun`."""
    numbered = enumerate(history.scenario.events, start=1)
    return [
        f"event {number} ({event.__struct_config__.tag}) {why}"
        for number, event in numbered
        if (why := why_missing(history, number))
    ]


def ready_again(history: History, number: int) -> float:
    """How many s after a kill, the event of that number, its agent was ready again; infinite if it never was."""
    event, kill = history.scenario.events[number - 1], history.kills[number]
    assert isinstance(event, Kill)
    starts = [time - kill for time, agent in history.agent_starts if agent == event.agent and time > kill]
    return min(starts, default=math.inf)


def why_missing(history: History, number: int) -> str:
    """Why an event has not happened, e.g. `has not begun`; empty if it has."""
    if number in history.given_up:
        return f"could not be carried out: {history.given_up[number]}"
    if number in history.kills or history.spans.get(number, (0.0, None))[1] is not None:
        return ""
    return f"has not {'ended' if number in history.spans else 'begun'}"


def _true_relations(check: TrueRelationsCheck, history: History, sample: Sample) -> Finding:
    found = true_relations(history.scenario, sample.truth, sample.gripped)
    return found.issuperset(check.present) and found.isdisjoint(check.absent), pairs(found)


def _relations_right(check: RelationsRight, history: History, sample: Sample) -> Finding:
    true = true_relations(history.scenario, sample.truth, sample.gripped)
    believed = {(src, dst) for kind, src, dst in sample.edges if kind == "on"}

    def find(name: str) -> Finding:
        below, wanted = ({lower for upper, lower in found if upper == name} for found in (believed, true))
        text = ", ".join(sorted(below)) or "nothing"
        return below == wanted, f"on {text}" + ("" if below == wanted else f", truly {', '.join(wanted) or 'nothing'}")

    return each(check, sample, find)


def _belief_recovered(check: BeliefRecovered, history: History, sample: Sample) -> Finding:
    if missing := missing_events(history):
        return False, "; ".join(missing)
    passed, texts = True, []
    for one in perturbations(history):
        found = recovery(history, one, check.tolerance, check.objects)
        seconds = found.seconds if found.seconds == math.inf else counted(history, one.end, one.end + found.seconds)
        holds = seconds <= check.within
        passed = passed and holds
        which = f"event {', '.join(map(str, one.events))}: "
        if why := unjudged(one, found):
            texts.append(which + why)
        else:
            took = "not recovered" if found.seconds == math.inf else f"{seconds:.2f} s"
            if seconds < found.seconds < math.inf:
                took += f", and {found.seconds - seconds:.2f} s without a frame"
            off = "no belief" if found.error == math.inf else f"{mm(found.error)} off"
            texts.append(which + took + (f" ({found.last}, {off} until then)" if found.last else ""))
    return passed, "; ".join(texts)


def _gone(check: Gone, history: History, sample: Sample) -> Finding:
    edges = {src for kind, src, _ in sample.edges if kind == "on"}

    def find(name: str) -> Finding:
        signs = {
            "still present": name not in sample.absent,
            "has a belief": name in sample.beliefs,
            "rests on something": name in edges,
        }
        wrong = [text for text, holds in signs.items() if holds]
        return not wrong, ", ".join(wrong) or "gone"

    return each(check, sample, find)


def _surprising(check: Surprising, history: History, sample: Sample) -> Finding:
    def find(name: str) -> Finding:
        surprising = name in sample.surprising
        return surprising is check.value, "surprising" if surprising else "not surprising"

    return each(check, sample, find)


def _surprises(check: SurprisesCheck, history: History, sample: Sample) -> Finding:
    names = {spec.name for spec in history.scenario.objects} if check.objects is None else set(names_of(check, sample))
    found = rises(history, begin_of(check, history, 0.0) or 0.0, sample.time, names)
    text = f"{len(found)}" + (f": {', '.join(f'{name} at {time:.2f} s' for time, name in found)}" if found else "")
    return _is_within(len(found), check), text


def _mission(check: MissionCheck, history: History, sample: Sample) -> Finding:
    state = history.mission(sample.time)
    if state is None:
        return False, "there was no intention"
    why = f": {state.explanation}" if state.explanation else ""
    return state.status == check.status, f"{state.status} since {state.time:.1f} s{why}"


def _replans(check: Replans, history: History, sample: Sample) -> Finding:
    if not history.missions:
        return False, "there was no intention"
    count = history.replans(sample.time)
    return _is_within(count, check), str(count)


def _is_within(count: int, check: SurprisesCheck | Replans) -> bool:
    return check.least <= count and (check.most is None or count <= check.most)


COURSE: dict[type, Callable[[Any, History, Sample], Finding]] = {
    TrueRelationsCheck: _true_relations,
    RelationsRight: _relations_right,
    BeliefRecovered: _belief_recovered,
    Gone: _gone,
    Surprising: _surprising,
    SurprisesCheck: _surprises,
    MissionCheck: _mission,
    Replans: _replans,
}
"""How each of these checks is judged."""
