"""The skill `pick`: grasp an object from above or, where that cannot be, from the side, and lift it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from functools import partial

from agents.arm_controller.grasping.grasps import FROM_SIDE, Grasp, GraspError, grasps
from agents.arm_controller.grasping.holding import WIDTH_TOLERANCE, Expected
from agents.arm_controller.grasping.side_grasps import side_grasps
from agents.arm_controller.motion.execution import OvertakenError
from agents.arm_controller.motion.routes import UP, JointGoal
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.scene import Obstacle
from agents.arm_controller.skills.manipulator import Manipulator
from agents.arm_controller.skills.steps import (
    Attempt,
    DroppedError,
    ImpossibleError,
    InTheWayError,
    SkillError,
    Steps,
)
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intentions import NOTHING_GRASPED

SAME_PLACE = PoseTolerance(0.005, 0.1)
"""m, rad by which a target may move without aiming again"""

LIFTED = 0.06
"""m of the way up after which an object that is seen where it stood was left behind: belief and camera lag by less"""

_MOST_AIMS = 5
_MOST_GRASPS = 3  # of one pick: what slips three times slips a fourth time
_LONGER = 2.0  # times the usual way at the end that is tried from the side, too: out of a niche, where room is scarce
_KNOWN_WITHIN = 0.5  # s after contact until the object between the pads must be known


def pick(arm: Manipulator, name: str) -> Steps[None]:
    """Grasp the object `name` and lift it straight up; again, some times, if it slips out of the gripper."""
    if arm.joints.contact or arm.holding.held is not None:
        raise SkillError(f"the gripper holds {arm.holding.held or 'something'} already")
    for number in range(2, _MOST_GRASPS + 2):
        grasp, attempt = yield from _reach(arm, name)
        problem = yield from _close(arm, name, grasp)
        if problem:
            yield from _give_back(arm, grasp)
            raise SkillError(problem)
        try:
            yield from _lift(arm, name, grasp, attempt)
            return
        except DroppedError as slip:
            yield from arm.settle()
            yield from _give_back(arm, grasp)
            if number > _MOST_GRASPS:
                raise SkillError(f"{slip}, as {_MOST_GRASPS} times") from slip
            arm.note = f"{slip}: grasp {number} of {_MOST_GRASPS}"


def _lift(arm: Manipulator, name: str, grasp: Grasp, attempt: Attempt) -> Steps[None]:
    """Lift the object. Raises `DroppedError`, with the arm about to stop, if it slips out of the gripper."""
    began = arm.tool
    stood = arm.believed(name).pose
    for step in arm.lift(name, attempt.goal.approach):
        yield step
        left = arm.tool.distance(began)[0] > LIFTED and _stands(arm, name, stood)
        if slip := f"{name} was left behind" if left else _slip(arm, name, grasp):
            arm.hold_still()
            raise DroppedError(slip)


def _slip(arm: Manipulator, name: str, grasp: Grasp) -> str:
    """How the object slips, if the fingers close further than it is wide; empty if they do not."""
    return f"{name} slipped out" if arm.joints.opening < grasp.width - WIDTH_TOLERANCE else ""


def _stands(arm: Manipulator, name: str, stood: Pose) -> bool:
    """Whether the object is seen to be where it stood."""
    seen = arm.scene.object(name)
    return seen is not None and arm.scene.is_perceived(name) and SAME_PLACE.covers(seen.pose, stood)


def _give_back(arm: Manipulator, grasp: Grasp) -> Steps[None]:
    """Open the gripper and move it away from what it lost, or must not hold."""
    yield from arm.open(grasp.opening)
    while arm.holding.held is not None:
        yield "release"
    yield from arm.retreat(arm.out, None)


def _reach(arm: Manipulator, name: str) -> Steps[tuple[Grasp, Attempt]]:
    """Bring the open gripper around the object; anew, some times, if that moves meanwhile."""
    for _ in range(_MOST_AIMS):
        aimed = yield from arm.right_of_way.cleared(partial(_aim, arm, name), lambda aim: aim[3])
        target, grasp, attempt, trajectory = aimed
        yield from arm.open(grasp.opening)
        arm.start(trajectory, attempt)
        if (yield from _approach(arm, target)):
            return grasp, attempt
    raise SkillError(f"{name} keeps moving")


def _aim(arm: Manipulator, name: str) -> Steps[tuple[Obstacle, Grasp, Attempt, Trajectory]]:
    """The object where it is believed to be now, with a grasp and the way there."""
    target = arm.believed(name)
    return target, *(yield from _choose(arm, target))


def _choose(arm: Manipulator, target: Obstacle) -> Steps[tuple[Grasp, Attempt, Trajectory]]:
    """The best grasp that can be reached, with the way there."""
    room, widest = arm.around.room(target.name, arm.joints.stamp), arm.figure.widest
    problem: SkillError | None = None
    found: list[tuple[Grasp, Attempt]] = []
    try:
        found = _reached(arm, target, grasps(target, room, widest))
        index, trajectory = yield from arm.ways.first([attempt for _, attempt in found], searched=False)
        return *found[index], trajectory
    except GraspError as error:
        problem = ImpossibleError(str(error))
    except InTheWayError as error:
        if arm.around.is_arm(error.by):
            raise
        problem = error
    except SkillError as error:
        problem = error
    sides = side_grasps(target, room, widest, arm.scene.world_from(arm.config.arm).t)
    with contextlib.suppress(SkillError):  # that there is no other way is no news
        found += _reached(arm, target, sides) if sides else []
    if not found:
        raise problem
    try:
        index, trajectory = yield from arm.ways.first([attempt for _, attempt in found])
    except SkillError as error:
        raise (SkillError(str(problem)) if isinstance(problem, ImpossibleError) else problem) from error
    return *found[index], trajectory


def _reached(arm: Manipulator, target: Obstacle, candidates: Sequence[Grasp]) -> list[tuple[Grasp, Attempt]]:
    """The grasps that the arm can reach, the best first. Raises `SkillError` without any."""
    from_side = candidates[0].rank[0] == FROM_SIDE
    solved = arm.ways.solve([grasp.world_from_tool for grasp in candidates], thorough=from_side)
    solved.sort(key=lambda pair: candidates[pair[0]].rank)
    found = []
    for length in (1.0, _LONGER) if from_side else (1.0,):
        for index, positions in solved:
            grasp = candidates[index]
            x, y, z = (-grasp.world_from_tool.rotation_matrix[:, 2]).tolist()
            goal = JointGoal(positions, length * arm.config.approach, (x, y, z) if from_side else UP)
            found.append((grasp, Attempt(goal, grasp.opening, target.name)))
    return found


def _approach(arm: Manipulator, target: Obstacle) -> Steps[bool]:
    """Go down around the target; returns False, with the arm at rest, if it, or something into the way, has moved."""
    try:
        while not arm.has_arrived():
            yield "approach"
            if not SAME_PLACE.covers(arm.believed(target.name).pose, target.pose):
                arm.hold_still()
                yield "aim"
                yield from arm.settle()
                return False
    except OvertakenError:
        yield from arm.settle()
        return False
    return True


def _close(arm: Manipulator, name: str, grasp: Grasp) -> Steps[str]:
    """Close the gripper; returns what is wrong with what is between the pads then, or nothing."""
    meant = Expected(name, grasp.width, grasp.world_from_tool.inverse() @ arm.believed(name).pose)
    arm.holding.expect(meant)
    contact = yield from arm.close()
    if too_hard := arm.fingers.problem(arm.joints):
        return too_hard
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
