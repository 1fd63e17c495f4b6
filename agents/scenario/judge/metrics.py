"""The numbers of a run, by name and with the unit at the end, and notes about missing ones.

Errors are averaged over all samples from the scenario's `settle` to the end in which the object has a belief
(percepts: and is perceived); gap and height error are those at the end; drift is the largest distance of the
belief from where it was at `settle`.
"""

from __future__ import annotations

import math

from agents.scenario.judge.accuracy import accuracy, unseen_curves
from agents.scenario.judge.cameras import camera_metrics
from agents.scenario.judge.course import missing_events, ready_again, rises
from agents.scenario.judge.perturbations import perturbations, recovery, recovery_in_view, unjudged, wrong_explanations
from agents.scenario.truth.actions import compare
from agents.scenario.truth.history import History, Sample, Source
from agents.scenario.truth.measures import OverlapMeter, belief_gap, drift, height_error, mean_error
from dsr.vocabulary.intentions import FULFILLED

RECOVERED = 0.005
"""m from the truth, within which a belief has recovered"""


def curves(history: History) -> dict[str, list[tuple[float, float]]]:
    """Measure curves of a finished run over time: (s, value in the unit at the end of the name)."""
    return unseen_curves(history, history.window(history.scenario.settle, history.end))


def measure(history: History) -> tuple[dict[str, float], list[str]]:
    """Metrics and notes of a finished run."""
    scenario = history.scenario
    window = history.window(scenario.settle, history.end)
    if not window:
        return {}, [f"no truth was received after {scenario.settle} s: nothing could be measured"]
    metrics: dict[str, float] = {}
    notes: list[str] = []
    for spec in scenario.objects:
        metrics |= _object_metrics(history, list(window), spec.name)
        notes += _notes(history, window[-1], spec.name)
    for source in ("percept", "belief"):
        worst = OverlapMeter(scenario, source).deepest(window, lambda name: True)
        metrics[f"{source}_overlap_max_m"] = worst.depth if worst else 0.0
    metrics["objects_perceived"] = sum(history.was_perceived(spec.name) for spec in scenario.objects)
    metrics["samples"] = len(window)
    metrics |= accuracy(history, window)
    metrics |= _course_metrics(history)
    metrics |= camera_metrics(history)
    if distances := [sample.apart for sample in history.samples if sample.apart is not None]:
        metrics["arms_apart_min_m"] = min(distances)
    return metrics, [*notes, *missing_events(history), *_unrecovered(history), *_about_actions(history)]


def _course_metrics(history: History) -> dict[str, float]:
    """Of the whole run: perturbations, surprise, explanations, mission."""
    scenario = history.scenario
    found: dict[str, float] = {}
    over = perturbations(history)
    times = [recovery(history, one, RECOVERED).seconds for one in over]
    for number, seconds in enumerate(times, start=1):
        if seconds < math.inf:
            found[f"recovery_time_{number}_s"] = seconds
    if times and max(times) < math.inf:
        found["recovery_time_max_s"] = max(times)
        found["recovery_in_view_max_s"] = max(recovery_in_view(history, one, RECOVERED) for one in over)
    restarts = [ready_again(history, number) for number in history.kills]
    if restarts and max(restarts) < math.inf:
        found["restart_max_s"] = max(restarts)
    everything = {spec.name for spec in scenario.objects}
    found["surprises_raised"] = len(rises(history, 0.0, history.end, everything))
    found["explanations"] = len(history.explanations)
    found["wrong_beliefs"] = len(wrong_explanations(history))
    if scenario.mission is not None:
        found["replans"] = history.replans(history.end)
        reached = [state.time for state in history.missions if state.status in FULFILLED]
        if reached:
            found["mission_first_reached_s"] = reached[0]
        last = history.mission(history.end)
        if last is not None and last.status in FULFILLED:
            found["mission_reached_s"] = last.time
    return found


def _about_actions(history: History) -> list[str]:
    """What was done and not inferred, or inferred and not done."""
    comparison = compare(history)
    missed = [f"{match.true} at {match.true.time:.2f} s" for match in comparison.matches if match.inferred is None]
    extra = [f"{inferred.action} at {inferred.action.time:.2f} s" for inferred in comparison.extra]
    texts = {"not inferred": missed, "inferred, but not done": extra}
    return [f"{text}: {', '.join(which)}" for text, which in texts.items() if which]


def _unrecovered(history: History) -> list[str]:
    """One line for each reason why perturbations have no recovery time."""
    reasons: dict[str, list[str]] = {}
    for number, one in enumerate(perturbations(history), start=1):
        if (found := recovery(history, one, RECOVERED)).seconds == math.inf:
            why = unjudged(one, found) or f"{found.last} was never believed within {1000 * RECOVERED:g} mm of the truth"
            reasons.setdefault(why, []).append(f"{number} (event {', '.join(map(str, one.events))})")
    return [f"no recovery time of perturbation {', '.join(which)}: {why}" for why, which in reasons.items()]


def _object_metrics(history: History, window: list[Sample], name: str) -> dict[str, float]:
    found: dict[str, float | None] = {}
    sources: tuple[Source, Source] = ("percept", "belief")
    for source in sources:
        if error := mean_error(window, source, name):
            found[f"{source}_error_{name}_m"] = error.position
            found[f"{source}_error_{name}_rad"] = error.rotation
    gap = belief_gap(history.scenario, window[-1], name)
    found[f"belief_gap_{name}_m"] = gap
    found[f"belief_height_error_{name}_m"] = height_error(window[-1], name)
    found[f"belief_drift_{name}_m"] = drift(window, name)
    return {key: value for key, value in found.items() if value is not None and value != float("inf")}


def _notes(history: History, last: Sample, name: str) -> list[str]:
    if not history.was_perceived(name):
        hint = "" if name in last.perceived else ", and no agent has made a node of it"
        return [f"{name} was never seen{hint}: it has no percept metrics"]
    if name in last.truth and name not in last.beliefs:
        return [f"{name} has no belief at the end"]
    return []
