"""Goes straight to joint positions that somebody wrote: around nothing, and into nothing."""

from __future__ import annotations

from functools import partial

from agents.arm_controller.motion.routes import JointGoal
from agents.arm_controller.skills.manipulator import Manipulator, itself
from agents.arm_controller.skills.steps import Attempt, Steps, at_once
from dsr.math3d.boxes import Array


def go_straight(arm: Manipulator, goal: Array) -> Steps[None]:
    """Bring the joints to `goal` (n,) rad, straight in joint space.

    Raises:
        BlockedError: for a way through a thing, a zone or the arm itself, or out of the workspace.
        SkillError: if another arm does not give way.
        MotionError: if the arm does not follow.
    """
    yield from arm.settle()
    plan = partial(arm.ways.through, goal[None])
    trajectory = yield from arm.right_of_way.cleared(lambda: at_once(plan), itself)
    arm.start(trajectory, Attempt(JointGoal(goal), arm.joints.opening))
    while not arm.has_arrived():
        yield "move"
