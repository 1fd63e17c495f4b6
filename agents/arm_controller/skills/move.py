"""The skills `move`, `observe` and `stop`."""

from __future__ import annotations

from functools import partial

import numpy as np

from agents.arm_controller.routes import Goal
from agents.arm_controller.skills.manipulator import Manipulator, SkillError, Steps, first_free
from dsr.transforms import Pose


def move(arm: Manipulator, target_pose: Pose | None) -> Steps[None]:
    """Bring the tool point to `target_pose` (world_from_tool)."""
    if target_pose is None:
        raise SkillError("where to? the action has no target_pose")
    solved = arm.solve([target_pose])
    opening = arm.joints.opening
    way = first_free([partial(arm.way_to, Goal(q), opening) for _, q in solved])
    yield from arm.go(way, "move", arm.holding.held)


def observe(arm: Manipulator) -> Steps[None]:
    """Go where the arm hides nothing from the camera."""
    joints = arm.config.observe_joints
    if not joints:
        raise SkillError("the arm's configuration has no observe_joints")
    way = first_free([partial(arm.way_to, Goal(np.array(joints)), arm.joints.opening)])
    yield from arm.go(way, "move", arm.holding.held)


def stop(arm: Manipulator) -> Steps[None]:
    """Hold still at once."""
    arm.hold_still()
    yield "stop"
