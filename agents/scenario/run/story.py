"""The story of a run, line by line: mission, plan, actions, moves of the experimenter, surprises, explanations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum
from typing import NamedTuple

import msgspec

from agents.scenario.format.scenario import Event
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.runtime.logs import printable
from dsr.timeline import explanations
from dsr.vocabulary.calibration import CALIBRATED, IN_DOUBT, STEADY
from dsr.vocabulary.intentions import (
    ACTIVE,
    EXECUTING,
    FAILED,
    FULFILLED,
    GIVEN_UP,
    HALTED,
    PLANNED,
    PLANNING,
    RUNNING,
    WAITING,
    WANTED,
    describe_action,
    nobody_pursues,
)
from dsr.vocabulary.relations import nodes_by_name
from dsr.vocabulary.sentences import explained_sentence, rejected_sentences

_TO_DO = (PLANNED, RUNNING)
_NO_PLAN = ("", "observe", "look")
"""Skills of the arm that lead to no goal: it only gets out of the way, or looks for something"""
_TOLD_BY_ACTIONS = (PLANNING, EXECUTING)
_NOT_TOLD = ("at", "when", "delay")
_MOST_SURPRISES = 3  # in a line
_LONGEST = 200  # characters of a line


class Topic(StrEnum):
    """The topic of a line."""

    MISSION = "mission"
    PLAN = "plan"
    ACTION = "action"
    MOVE = "experimenter"
    SURPRISE = "surprise"
    EXPLANATION = "explanation"
    CAMERA = "camera"


class Line(NamedTuple):
    """One thing that happened."""

    topic: Topic
    text: str
    good: bool = True
    """False for what went wrong."""


class Story:
    """Compares the working memory with the lines that were told before.

    Args:
        memory: only read.
        events: of the scenario, in the order of the file.
    """

    def __init__(self, memory: Memory, events: Iterable[Event]) -> None:
        self._memory = memory
        self._events = list(events)
        self._begun: set[int] = set()
        self._intentions: dict[str, tuple[str, str, int]] = {}
        self._given_up: dict[str, tuple[str, str]] = {}
        self._unattended = ""
        self._actions: dict[str, str] = {}
        self._plans: dict[str, int] = {}
        self._surprising: set[str] = set()
        self._explained: set[tuple[str, float]] = set()
        self._mounts: dict[str, str] = {}
        self._calibrated: set[str] = set()

    def news(self, begun: Iterable[int]) -> list[Line]:
        """Lines about everything since the last call.

        Args:
            begun: numbers of the scenario's events (from 1) that have begun.
        """
        lines = [*self._moves(begun), *self._surprises(), *self._explanations(), *self._cameras()]
        lines += [*self._missions(), *self._progress()]
        return [line._replace(text=_shortened(line.text)) for line in lines]

    def _moves(self, begun: Iterable[int]) -> Iterator[Line]:
        for number in sorted(set(begun) - self._begun):
            self._begun.add(number)
            if 1 <= number <= len(self._events):
                yield Line(Topic.MOVE, describe(self._events[number - 1]))

    def _surprises(self) -> Iterator[Line]:
        found = {node.name: node for node in self._memory.nodes() if node.get("surprising", False)}
        new = [f"{name}: {found[name].get('surprise', '')}" for name in sorted(found.keys() - self._surprising)]
        self._surprising = set(found)
        if new:
            more = f" and {len(new) - _MOST_SURPRISES} more" if len(new) > _MOST_SURPRISES else ""
            yield Line(Topic.SURPRISE, "; ".join(new[:_MOST_SURPRISES]) + more)

    def _explanations(self) -> Iterator[Line]:
        for node in explanations(self._memory):
            key = (node.name, node.get("time", 0.0))
            if key not in self._explained:
                self._explained.add(key)
                yield Line(Topic.EXPLANATION, _explanation(node))

    def _cameras(self) -> Iterator[Line]:
        """Cameras that come into doubt, or out of it, and where they were found to be."""
        for event in nodes_by_name(self._memory, "event"):
            if event.get("kind") == CALIBRATED and event.name not in self._calibrated:
                self._calibrated.add(event.name)
                yield Line(Topic.CAMERA, event.get("text", ""))
        for node in nodes_by_name(self._memory, "camera"):
            mount, before = node.get("mount", STEADY), self._mounts.get(node.name, STEADY)
            self._mounts[node.name] = mount
            if mount not in (before, STEADY):
                yield Line(Topic.CAMERA, f"{node.name} {mount}: {node.get('explanation', '')}", mount != IN_DOUBT)

    def _missions(self) -> Iterator[Line]:
        for node in nodes_by_name(self._memory, "intention"):
            status, replans = node.get("status", ""), node.get("replans", 0)
            why = "" if status in _TOLD_BY_ACTIONS else node.get("explanation", "")
            before = self._intentions.get(node.name)
            if before == (status, why, replans):
                continue
            self._intentions[node.name] = (status, why, replans)
            if before is None:
                asked = " (and keep it so)" if node.get("maintain", False) else ""
                yield Line(Topic.MISSION, f"{node.get('goal', '')}{asked}")
            elif replans > before[2]:
                reason = node.get("explanation", "")
                yield Line(Topic.MISSION, f"planning again{f': {reason}' if reason else ''}", good=False)
            if status not in ("", WANTED, *_TOLD_BY_ACTIONS) and self._is_new(node.name, status, why):
                begins = status == WAITING and (before is None or before[0] != EXECUTING)  # nothing has failed yet
                good = status in FULFILLED or begins
                yield Line(Topic.MISSION, f"{status}: {why}" if why else status, good)
        yield from self._nobody()

    def _is_new(self, intention: str, status: str, why: str) -> bool:
        """Whether an outcome differs from the one before: what was tried again in vain is not told again."""
        if status in FULFILLED:
            self._given_up.pop(intention, None)
        if status not in GIVEN_UP:
            return True
        before = self._given_up.get(intention)
        self._given_up[intention] = (status, why)
        return before != (status, why)

    def _nobody(self) -> Iterator[Line]:
        """That something is wanted, and nobody is there who would pursue it."""
        wanted = any(node.get("status") in ACTIVE for node in self._memory.nodes("intention"))
        before, self._unattended = self._unattended, nobody_pursues(self._memory) if wanted else ""
        if self._unattended and not before:
            yield Line(Topic.MISSION, self._unattended, good=False)

    def _progress(self) -> Iterator[Line]:
        """Plans that were made, actions that run, and those that failed."""
        actions = sorted(self._memory.nodes("action"), key=lambda node: (node.get("order", 0), node.name))
        for plan, steps in _by_plan(actions).items():
            newest = max(node.get("order", 0) for node in steps)
            if newest > self._plans.get(plan, -1):
                told, self._plans[plan] = self._plans.get(plan, -1), newest
                new = [node for node in steps if node.get("order", 0) > told and node.get("status") in _TO_DO]
                if any(node.get("skill", "") not in _NO_PLAN for node in new):
                    yield Line(Topic.PLAN, "; ".join(map(describe_action, new)))
            for position, node in enumerate(steps, 1):
                status, before = node.get("status", ""), self._actions.get(node.name)
                self._actions[node.name] = status
                if status == before:
                    continue
                if status == RUNNING:
                    yield Line(Topic.ACTION, f"{position} of {len(steps)}: {describe_action(node)}")
                elif status in (FAILED, HALTED):
                    why = node.get("explanation", "")
                    yield Line(Topic.ACTION, f"{describe_action(node)} {status}{f': {why}' if why else ''}", good=False)


def describe(event: Event) -> str:
    """Describe an event in words, such as `slide cube_4 by 0.1, 0.04`."""
    fields: Mapping[str, object] = msgspec.to_builtins(event)
    objects = [str(fields["object"])] if "object" in fields else []
    defaults = {field.name: field.default for field in msgspec.structs.fields(event)}
    others = [
        f"{name} {_value(value)}"
        for name, value in fields.items()
        if name in defaults and name not in ("object", *_NOT_TOLD) and getattr(event, name) != defaults[name]
    ]
    return " ".join([str(event.__struct_config__.tag).replace("_", " "), *objects, ", ".join(others)]).strip()


def _value(value: object) -> str:
    if isinstance(value, tuple | list):
        return ", ".join(map(_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _explanation(node: Node) -> str:
    """The explanation with its score, and the best of those that were rejected."""
    score = f" (score {node['score']:.1f})" if "score" in node else ""
    rejected = rejected_sentences(node.attributes)
    others = f", and {len(rejected) - 1} more" if len(rejected) > 1 else ""
    best = f". Rejected: {rejected[0].sentence} ({rejected[0].score}){others}" if rejected else ""
    return f"{explained_sentence(node.attributes)}{score}{best}"


def _by_plan(actions: Iterable[Node]) -> dict[str, list[Node]]:
    """Actions of one intention belong together: `action_N_K` is the K-th of `intention_N`."""
    plans: dict[str, list[Node]] = {}
    for node in actions:
        plans.setdefault(node.name.rpartition("_")[0], []).append(node)
    return plans


def _shortened(text: str) -> str:
    """One line of it that shows nothing but text."""
    text = " ".join(printable(text).split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."
