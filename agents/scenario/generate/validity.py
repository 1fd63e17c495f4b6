"""Judges by the plant alone whether a drawn episode can be meant: no belief takes part."""

from __future__ import annotations

import msgspec

from agents.scenario.check.faults import deepest, faults
from agents.scenario.format.events import CameraBump, CameraCover, FalsePercept
from agents.scenario.format.expectations import BeliefError
from agents.scenario.format.model import Scenario
from agents.scenario.generate.draft import TOP
from agents.scenario.generate.registry import Family
from agents.scenario.judge.course import missing_events
from agents.scenario.truth.actions import FALLEN
from agents.scenario.truth.history import History
from agents.scenario.truth.phases import phases

WORKSPACE = (3.0, 3.0, 2.5)
"""m: half the plant's floor along x and y, and a height that no hand reaches: what is beyond is lost for good"""
PRESSED = 0.002
"""m, how deep things at rest may be in each other at the start: contact of the physics engine has 1 mm of slack"""
HAPPENED = 0.01
"""m, that something must move for an episode in which something happens: what is surprising (`surprise_distance`)"""
TIPPED = 0.3
"""rad, that something leaning may still turn until it rests: more, and it has fallen over"""
SEEN_SHARE = 0.5
"""Share of the things, at least, that the camera recognises at the beginning: of fewer little can be believed"""
AT_THE_END = 1.5
"""s before the end, in which a thing must rest in view for its belief to be expected to be right"""
RIGHT = 0.005
"""m from the truth, of the belief of what rests in view, beside what its sensor errs"""


def why_invalid(history: History, family: Family) -> str:
    """Why the true course of an episode is none of its family; empty if it is one."""
    if missing := missing_events(history):
        return missing[0]
    if found := faults(history):
        return found[0].text
    return _bad_start(history) or _lost(history, family) or _nothing_happens(history)


def with_expectations(history: History) -> Scenario:
    """The scenario with what any good belief knows at the end: where things are that rest in view."""
    scenario, last = history.scenario, history.window(history.end - AT_THE_END, history.end)
    names = [
        spec.name
        for spec in scenario.objects
        if all(spec.name in one.in_view and spec.name not in {*one.moving, *one.grasped} for one in last)
    ]
    sensor = scenario.sensor
    tolerance = round(RIGHT + max(map(abs, sensor.depth_bias)) + 2 * sensor.depth_jitter, 4)  # m; 2: 95 % of a Gaussian
    checks = [BeliefError(objects=tuple(names), tolerance=tolerance)] if names else []
    return msgspec.structs.replace(scenario, expectations=checks)


def _bad_start(history: History) -> str:
    scenario, first = history.scenario, history.samples[0]
    for spec in scenario.objects:
        if spec.name not in first.truth:
            return f"{spec.name} is not there at the start"
        pose = first.truth[spec.name]
        others = {name: other for name, other in first.truth.items() if name != spec.name}
        other, depth = deepest(spec.name, pose, others, scenario)
        if depth > PRESSED:
            return f"{spec.name} is {1000 * depth:.1f} mm inside {other} at the start"
        if spec.position[2] - pose.t[2] > FALLEN and not any(spec.lean):
            return f"{spec.name} falls at the start"
        if any(spec.lean) and spec.pose.distance(pose)[1] > TIPPED:
            return f"{spec.name} does not stay as it leans"
    early = history.window(0.0, scenario.settle)
    seen = {name for sample in early for name in sample.in_view}
    if len(seen) < SEEN_SHARE * len(scenario.objects):
        return f"only {len(seen)} of {len(scenario.objects)} things are seen at the beginning"
    return ""


def _lost(history: History, family: Family) -> str:
    """Things that leave the table, or the workspace."""
    x, y, z = WORKSPACE
    for sample in history.samples:
        for name, pose in sample.truth.items():
            if abs(pose.t[0]) > x or abs(pose.t[1]) > y or not -PRESSED < pose.t[2] < z:
                return f"{name} leaves the workspace at {sample.time:.1f} s"
            if pose.t[2] < TOP - PRESSED and not family.may_fall:
                return f"{name} falls off the table by {sample.time:.1f} s"
    return ""


def _nothing_happens(history: History) -> str:
    senses = (CameraBump, CameraCover, FalsePercept)
    happened = any(phase.moved > HAPPENED or phase.gone or phase.turned > HAPPENED for phase in phases(history))
    if happened or any(isinstance(event, senses) for event in history.scenario.events):
        return ""
    return "nothing happens"
