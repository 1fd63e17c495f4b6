"""Action nodes: the plan in the graph, the requests to the arm, and the arm's reports."""

from __future__ import annotations

import contextlib
import sys
from typing import Any, NamedTuple

from dsr.errors import GraphError
from dsr.graph.elements import Node
from dsr.graph.schema import is_name
from dsr.memory import Memory
from dsr.vocabulary.arms import arm_of_action
from dsr.vocabulary.intentions import ENDED, FAILED, MIND, PLANNED, PREFIX, RUN, RUNNING
from planner.grounding import Skill
from planner.intentions import read_number

_SOURCE = "planner"


class Progress(NamedTuple):
    """The arm's report about an action."""

    status: str
    explanation: str
    hopeless: bool = False
    """Whether the action would fail again while the belief stays as it is."""


GONE = Progress(FAILED, "somebody removed the action")


def can_have_actions(intention: str) -> bool:
    """Whether an intention of that name leaves room for the names of its actions, however many there will be."""
    return is_name(f"{_stem(intention)}{sys.maxsize}")


def _stem(intention: str) -> str:
    return f"action_{intention.removeprefix(PREFIX)}_"


class Actions:
    """The action nodes below one intention.

    Names are never used twice in the life of an intention, so that nobody takes a new action for an old one.
    """

    def __init__(self, memory: Memory, intention: str) -> None:
        self._memory = memory
        self._intention = intention
        self._stem = _stem(intention)
        names = [node.name for node in own_actions(memory) if node.name.startswith(self._stem)]
        numbers = [number for name in names if (number := read_number(name, self._stem)) is not None]
        self._next = max(numbers, default=-1) + 1
        self._names: list[str] = []

    def write(self, skills: list[Skill]) -> list[str]:
        """Write a plan behind the present actions; returns the names of its nodes."""
        names = []
        for skill in skills:
            name = self.write_apart(skill)
            if self._names:
                self._memory.add_edge(self._names[-1], name, "next")
            self._names.append(name)
            names.append(name)
        return names

    def write_apart(self, skill: Skill) -> str:
        """Write an action that is no part of the plan; returns the name of its node. `drop` leaves it alone."""
        name = f"{self._stem}{self._next}"
        self._add(name, skill)
        self._next += 1
        return name

    def _add(self, name: str, skill: Skill) -> None:
        memory = self._memory
        values: dict[str, Any] = {"target": skill.target, "destination": skill.destination}
        if skill.target_pose is not None:
            values["target_pose"] = skill.target_pose
        if skill.arm:
            values["arm"] = skill.arm
        values |= {"order": self._next, "skill": skill.name, "status": PLANNED, "request": "", "source": _SOURCE}
        memory.add_node(name, "action", **values)
        parent = self._intention if self._intention in memory else MIND
        with contextlib.suppress(GraphError):
            memory.add_edge(parent, name, "has")

    def ask(self, name: str, request: str) -> None:
        """Let the arm run or halt an action."""
        with contextlib.suppress(GraphError):
            self._memory.update_node(name, request=request)

    def aim(self, name: str, skill: Skill) -> None:
        """Change where an action that was not begun shall end."""
        with contextlib.suppress(GraphError):
            self._memory.update_node(name, target_pose=skill.target_pose)

    def progress(self, name: str) -> Progress:
        """Read the arm's report about an action."""
        node = self._memory.get_node(name)
        return GONE if node is None else _progress(node)

    def drop(self, *, ended_too: bool) -> None:
        """Remove the nodes of the plan; those that have ended only if wanted."""
        kept = [] if ended_too else [name for name in self._names if self.progress(name).status in ENDED]
        for name in self._names:
            if name not in kept:
                self._memory.remove_node(name)
        self._names = [name for name in kept if name in self._memory]


def _progress(node: Node) -> Progress:
    return Progress(node.get("status", PLANNED), node.get("explanation", ""), node.get("hopeless") is True)


def own_actions(memory: Memory) -> list[Node]:
    """List all action nodes that a planner wrote, in order of their names."""
    return sorted((node for node in memory.nodes("action") if node.get("source") == _SOURCE), key=lambda n: n.name)


def is_under_way(node: Node) -> bool:
    """Whether the arm runs the action, or may be about to."""
    status = _progress(node).status
    return status == RUNNING or (status == PLANNED and node.get("request", "") == RUN)


def other_action(memory: Memory, own: str, arm: str) -> str | None:
    """An action that the arm carries out now, other than `own`."""
    running = [node for node in memory.nodes("action") if _progress(node).status == RUNNING]
    names = sorted(node.name for node in running if arm_of_action(memory, node) == arm)
    return next((name for name in names if name != own), None)
