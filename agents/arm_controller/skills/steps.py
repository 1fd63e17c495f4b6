"""What skills are made of: steps that a tick advances, places to go to, and the reasons why they end."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeVar

from agents.arm_controller.motion.routes import JointGoal
from dsr.errors import DsrError

T = TypeVar("T")
Steps = Generator[str, None, T]
"""Yields the name of the step under way at each tick, and returns a `T` at the end."""


class SkillError(DsrError):
    """A skill cannot go on."""


class ImpossibleError(SkillError):
    """A skill cannot be done as long as the belief about things stays as it is."""


class InTheWayError(SkillError):
    """No way is free.

    Args:
        by: name of what is in the way.
    """

    def __init__(self, by: str) -> None:
        super().__init__(f"{by} is in the way")
        self.by = by


class DroppedError(SkillError):
    """The gripper does not hold any more what it held."""


@dataclass(frozen=True)
class Attempt:
    """A place to go to, one of several that would do."""

    goal: JointGoal
    """Joint positions at the end."""
    opening: float
    """m between the fingers on the way"""
    target: str = ""
    """Name of the thing that the gripper may be around at the end; empty for none."""


def at_once(plan: Callable[[], T]) -> Steps[T]:
    """A plan that is made within one tick, as steps."""
    yield from ()
    return plan()
