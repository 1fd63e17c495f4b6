"""The skills `move`, `look`, `observe` and `stop`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from agents.arm_controller.motion.execution import OvertakenError
from agents.arm_controller.motion.routes import JointGoal
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.skills.manipulator import Manipulator
from agents.arm_controller.skills.steps import Attempt, InTheWayError, SkillError, Steps
from dsr.math3d.boxes import Array
from dsr.math3d.transforms import Pose

_MOST_WAYS = 5  # that are planned to one goal, one after the other, as long as things come in the way
_TURNS = 8
"""Ways in which a camera is turned about its axis for the same look, evenly spaced"""


def move(arm: Manipulator, target_pose: Pose | None) -> Steps[None]:
    """Bring the tool point to `target_pose` (world_from_tool)."""
    if target_pose is None:
        raise SkillError("where to? the action has no target_pose")
    yield from _bring(arm, [target_pose])


def look(arm: Manipulator, camera: str, target_pose: Pose | None) -> Steps[None]:
    """Bring a camera that the gripper carries to `target_pose` (world_from_camera), turned about its axis as suits."""
    if target_pose is None:
        raise SkillError("where from? the action has no target_pose")
    gripper_from_camera = arm.scene.mounted(arm.config.gripper, camera)
    if gripper_from_camera is None:
        raise SkillError(f"{camera} is not carried by {arm.config.gripper}")
    camera_from_tool = gripper_from_camera.inverse() @ arm.holding.gripper_from_tool
    turns = (Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 2 * math.pi * k / _TURNS)) for k in range(_TURNS))
    yield from _bring(arm, [target_pose @ turn @ camera_from_tool for turn in turns])


def _bring(arm: Manipulator, poses: Sequence[Pose]) -> Steps[None]:
    """Bring the tool point to one of `poses` (world_from_tool), that which takes the least motion and is free."""
    yield from _go_to_one(arm, lambda: [q for _, q in arm.ways.solve(poses)], poses)


def _go_to_one(arm: Manipulator, goals: Callable[[], Sequence[Array]], poses: Sequence[Pose] = ()) -> Steps[None]:
    """Go to the first of joint positions that is free; anew if something has come in the way meanwhile.

    If none is, other joint positions will do that bring the tool point to one of `poses` (world_from_tool).
    """
    held = arm.holding.held
    for left in reversed(range(_MOST_WAYS)):
        plan = arm.right_of_way.cleared(lambda: _first(arm, goals(), poses), lambda found: found[1])
        attempt, trajectory = yield from plan
        try:
            yield from arm.go(trajectory, attempt, "move", held)
            return
        except OvertakenError:
            if not left:
                raise
            yield from arm.settle()


def _first(arm: Manipulator, goals: Sequence[Array], poses: Sequence[Pose]) -> Steps[tuple[Attempt, Trajectory]]:
    """The first of joint positions that is free, with the way there."""
    attempts = [Attempt(JointGoal(q), arm.joints.opening) for q in goals]
    try:
        index, trajectory = yield from arm.ways.first(attempts, searched=False)
    except InTheWayError as error:
        if arm.around.is_arm(error.by):
            raise
        others = arm.ways.other_postures(poses, goals) if poses else []
        attempts += [Attempt(JointGoal(q), arm.joints.opening) for q in others]
        index, trajectory = yield from arm.ways.first(attempts)
    return attempts[index], trajectory


def observe(arm: Manipulator) -> Steps[None]:
    """Go where the arm hides nothing from the camera."""
    joints = arm.config.observe_joints
    if not joints:
        raise SkillError("the arm's configuration has no observe_joints")
    yield from _go_to_one(arm, lambda: [np.array(joints)])


def stop(arm: Manipulator) -> Steps[None]:
    """Hold still at once."""
    arm.hold_still()
    yield "stop"
