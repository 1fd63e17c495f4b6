"""The skill `pick`: grasp an object from above and lift it."""

from __future__ import annotations

from functools import partial

from agents.arm_controller.grasps import Grasp, GraspError, grasps
from agents.arm_controller.holding import WIDTH_TOLERANCE
from agents.arm_controller.routes import JointGoal
from agents.arm_controller.scene import Obstacle
from agents.arm_controller.skills.manipulator import ImpossibleError, Manipulator, SkillError, Steps, first_free
from agents.arm_controller.trajectory import Trajectory
from dsr.math3d.tolerance import PoseTolerance
from dsr.vocabulary.intentions import NOTHING_GRASPED

SAME_PLACE = PoseTolerance(0.005, 0.1)
"""m, rad by which a target may move without aiming again"""

_MOST_AIMS = 5
_KNOWN_WITHIN = 0.5  # s after contact until the object between the pads must be known


def pick(arm: Manipulator, name: str) -> Steps[None]:
    """Grasp the object `name` and lift it straight up."""
    if arm.joints.contact or arm.holding.held is not None:
        raise SkillError(f"the gripper holds {arm.holding.held or 'something'} already")
    for _ in range(_MOST_AIMS):
        target, grasp, trajectory = yield from arm.cleared(partial(_aim, arm, name), lambda aim: aim[2])
        yield from arm.open(grasp.opening)
        if (yield from _approach(arm, target, trajectory)):
            break
    else:
        raise SkillError(f"{name} keeps moving")
    problem = yield from _close(arm, name, grasp)
    if problem:
        yield from arm.open(grasp.opening)
        yield from arm.rise(arm.holding.held)
        raise SkillError(problem)
    yield from arm.rise(name)


def _aim(arm: Manipulator, name: str) -> tuple[Obstacle, Grasp, Trajectory]:
    """The object where it is believed to be now, with a grasp and the way there."""
    target = arm.believed(name)
    return target, *_choose(arm, target)


def _choose(arm: Manipulator, target: Obstacle) -> tuple[Grasp, Trajectory]:
    """The best grasp that can be reached, with the way there."""
    try:
        candidates = grasps(target, arm.room(target.name), arm.figure.widest)
    except GraspError as error:
        raise ImpossibleError(str(error)) from error
    solved = arm.solve([grasp.world_from_tool for grasp in candidates])
    solved.sort(key=lambda pair: candidates[pair[0]].rank)

    def trajectory(index: int, goal: JointGoal) -> tuple[Grasp, Trajectory]:
        grasp = candidates[index]
        return grasp, arm.trajectory_to(goal, grasp.opening, target.name)

    return first_free([partial(trajectory, index, JointGoal(q, arm.config.approach)) for index, q in solved])


def _approach(arm: Manipulator, target: Obstacle, trajectory: Trajectory) -> Steps[bool]:
    """Go down around the target; returns False, with the arm at rest, if it moved meanwhile."""
    arm.start(trajectory)
    while not arm.has_arrived():
        yield "approach"
        if not SAME_PLACE.covers(arm.believed(target.name).pose, target.pose):
            arm.hold_still()
            yield "aim"
            yield from arm.settle()
            return False
    return True


def _close(arm: Manipulator, name: str, grasp: Grasp) -> Steps[str]:
    """Close the gripper; returns what is wrong with what is between the pads then, or nothing."""
    contact = yield from arm.close()
    if not contact or abs(arm.joints.opening - grasp.width) > WIDTH_TOLERANCE:
        if not contact:
            return NOTHING_GRASPED
        return f"what is between the pads is {arm.joints.opening * 1e3:.0f} mm wide, not {grasp.width * 1e3:.0f} mm"
    until = arm.joints.stamp + _KNOWN_WITHIN
    while arm.holding.held is None and arm.joints.stamp < until:
        yield "check"
    if arm.holding.held != name:
        return f"between the pads is {arm.holding.held or 'nothing that is known'}"
    return ""
