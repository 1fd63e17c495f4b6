"""Intentions and the actions of their plans as nodes: their names, and the words of `status` and `request`.

Whoever wants something writes an intention below `mind`. From then on its `status` is the planner's, who writes actions
below it and asks for them by `request`; the `status` of an action is the arm controller's once it was asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from typing import Any

from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.network.keys import agent_of

_PLANNER = "planner"
"""The agent that pursues intentions"""
MIND = "mind"
"""The node from which intentions hang."""
MOST_INTENTIONS = 256
"""Intentions that are looked at: whoever may make their nodes could make any number."""
PREFIX = "intention_"
"""Prefix of the number in the name of an intention."""

WANTED, PLANNING, EXECUTING, WAITING = "wanted", "planning", "executing", "waiting"
ACTIVE = (WANTED, PLANNING, EXECUTING, WAITING)
"""Statuses of intentions that are still to be pursued."""
REACHED, MAINTAINED = "reached", "maintained"
FULFILLED = (REACHED, MAINTAINED)
"""Statuses of intentions whose goal holds."""
INVALID, UNSOLVABLE, NO_SOLVER = "invalid", "unsolvable", "no_solver"
FAILED = "failed"
"""Status of an intention or an action that failed."""
GIVEN_UP = (INVALID, UNSOLVABLE, FAILED, NO_SOLVER)
"""Statuses of intentions for which nothing more is done."""

PLANNED, RUNNING, DONE, HALTED = "planned", "running", "done", "halted"
ENDED = (DONE, FAILED, HALTED)
"""Statuses of actions that are over."""
NOTHING_GRASPED = "nothing between the pads"
"""`explanation` of a pick that failed because the gripper closed on nothing."""
RUN, HALT = "run", "halt"
"""Requests to an action."""


def describe_action(action: Node | Mapping[str, Any]) -> str:
    """An action in a few words: `place cube_3 on cube_4`.

    Args:
        action: its node, or the attributes of that.
    """
    where = f"on {action['destination']}" if action.get("destination", "") else ""
    return " ".join(part for part in (action.get("skill", ""), action.get("target", ""), where) if part)


def nobody_pursues(memory: Memory) -> str:
    """Why nothing becomes of any intention: the planner does not run; empty if it does."""
    runs = any(agent_of(rid) == _PLANNER for rid in memory.peers)
    return "" if runs else f"no agent {_PLANNER!r} runs, which would pursue it"


def add_intention(memory: Memory, goal: str, *, maintain: bool = False, priority: int = 0) -> str:
    """Write a new intention below `mind`; returns its name, `intention_N` with the smallest N that is free."""
    name = next(name for number in count() if (name := f"{PREFIX}{number}") not in memory)
    with memory.batch():
        if MIND not in memory:
            memory.add_node(MIND, "mind")
        memory.add_node(name, "intention", goal=goal, maintain=maintain, priority=priority, status=WANTED)
        memory.add_edge(MIND, name, "has")
    return name
