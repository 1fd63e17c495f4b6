"""The skill `place`: put the held object down on an object or on a table."""

from __future__ import annotations

from functools import partial

from agents.arm_controller.grasping.grasps import SIDE_ROOM, GraspError, resting_poses, upright
from agents.arm_controller.motion.execution import OvertakenError, StuckError
from agents.arm_controller.motion.routes import JointGoal
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.scene import Obstacle
from agents.arm_controller.skills.manipulator import Manipulator
from agents.arm_controller.skills.steps import Attempt, SkillError, Steps
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose

GAP = 0.001
"""m between the held object and its support when it is let go"""
EARLY = 0.015
"""m above its place at which the held object may meet its support"""
SAME_PLACE = PoseTolerance(0.01, 0.2)
"""m, rad by which an object to stand on may move without aiming again"""

_MOST_AIMS = 5


def place(arm: Manipulator, name: str, destination: str, target_pose: Pose | None) -> Steps[None]:
    """Put the held object down on `destination`, and rise.

    Args:
        arm: holds the object.
        name: of the held object; empty for whatever is held.
        destination: name of an object, in whose middle it is put, or of a table.
        target_pose: world_from_object, needed on a table only. Its x, y and yaw count; the height is the table's.

    Raises:
        SkillError: if it cannot be done.
    """
    held = arm.holding.held
    if held is None or (name and held != name):
        raise SkillError(f"the gripper holds {held or 'nothing'}, not {name or 'an object'}")
    if destination == held:
        raise SkillError(f"{held} cannot stand on itself")
    for _ in range(_MOST_AIMS):
        before = arm.scene.object(destination)
        attempt, trajectory = yield from arm.right_of_way.cleared(
            partial(_plan, arm, held, destination, target_pose), lambda found: found[1]
        )
        arm.start(trajectory, attempt)
        if (yield from _go_down(arm, held, before)):
            break
    else:
        raise SkillError(f"{destination} keeps moving")
    yield from arm.open(min(arm.joints.opening + SIDE_ROOM[0], arm.figure.widest))
    while arm.holding.held is not None and arm.joints.contact is False:
        yield "release"
    if arm.joints.contact:
        raise SkillError(f"{held} is still in the gripper")
    yield from arm.retreat(arm.out, None)


def _go_down(arm: Manipulator, held: str, destination: Obstacle | None) -> Steps[bool]:
    """To the place; returns False, with the arm at rest, if the object `destination` is seen to have moved meanwhile.

    It is False, too, if something came in the way. What stops the arm a little above its place is what the held object
    shall stand on.
    """
    try:
        while not arm.has_arrived():
            yield "approach"
            arm.check_held(held)
            if destination is not None and _has_moved(arm, destination):
                arm.hold_still()
                yield "aim"
                yield from arm.settle()
                return False
    except OvertakenError:
        yield from arm.settle()
        return False
    except StuckError:
        if arm.away() > EARLY:
            raise
        arm.hold_still()
    return True


def _has_moved(arm: Manipulator, destination: Obstacle) -> bool:
    """Whether a thing is seen elsewhere than it was; what is hidden is moved in the belief only, perhaps wrongly."""
    now = arm.scene.object(destination.name)
    if now is None or not arm.scene.is_perceived(destination.name):
        return False
    return not SAME_PLACE.covers(now.pose, destination.pose)


def _resting(arm: Manipulator, held: str, destination: str, target_pose: Pose | None) -> list[Pose]:
    """world_from_object of the held object at rest, in different ways."""
    object_in_tool = arm.tool_from_held
    assert object_in_tool is not None
    size = arm.believed(held).size
    carried = Obstacle(held, arm.tool @ object_in_tool, size)
    table = arm.scene.table(destination)
    try:
        if table is None:
            support = upright(arm.believed(destination))
            x, y, yaw, top = float(support.center[0]), float(support.center[1]), support.yaw, support.top
        elif target_pose is None:
            raise SkillError(f"where on {destination}? the action has no target_pose")
        else:
            goal = upright(Obstacle(held, target_pose, size))
            x, y, yaw, top = target_pose.t[0], target_pose.t[1], goal.yaw, table.top
        return resting_poses(carried, (x, y), top + GAP, yaw)
    except GraspError as error:
        raise SkillError(str(error)) from error


def _plan(
    arm: Manipulator, held: str, destination: str, target_pose: Pose | None
) -> Steps[tuple[Attempt, Trajectory]]:
    """The best way to put the held object there, as things are believed to be now."""
    attempts = _attempts(arm, held, _resting(arm, held, destination, target_pose))
    index, trajectory = yield from arm.ways.first(attempts)
    return attempts[index], trajectory


def _attempts(arm: Manipulator, held: str, resting: list[Pose]) -> list[Attempt]:
    """Ways to bring the held object to one of these poses (world_from_object); the least motion first."""
    object_in_tool = arm.tool_from_held
    assert object_in_tool is not None
    tool_from_object = object_in_tool.inverse()
    solved = arm.ways.solve([pose @ tool_from_object for pose in resting])
    return [Attempt(JointGoal(q, arm.config.approach), arm.joints.opening, held) for _, q in solved]
