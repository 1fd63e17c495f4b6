"""Goes straight to joint positions that somebody wrote: past things, but around nobody and into no zone."""

from __future__ import annotations

from functools import partial

from agents.arm_controller.skills.manipulator import Manipulator, itself
from agents.arm_controller.skills.steps import Steps, at_once
from dsr.math3d.boxes import Array


def go_straight(arm: Manipulator, goal: Array) -> Steps[None]:
    """Bring the joints to `goal` (n,) rad, straight in joint space.

    Raises:
        BlockedError: for a way through a zone, out of the workspace, or through the arm itself.
        SkillError: if another arm does not give way.
        MotionError: if the arm does not follow.
    """
    yield from arm.settle()
    plan = partial(arm.ways.straight, goal)
    trajectory = yield from arm.right_of_way.cleared(lambda: at_once(plan), itself)
    arm.start_straight(trajectory)
    while not arm.has_arrived():
        yield "move"
