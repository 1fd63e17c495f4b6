"""The simulated arm: joints that follow targets, and a gripper that holds an object between its pads."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.joint_ramp import Ramp
from agents.plant.bullet import Bullet
from agents.plant.world import STEP, World
from dsr.errors import ConfigError, suggest
from dsr.files.built_in import ETC
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

CAMERA_LINK = "camera_wrist_link"
"""Link of the URDF that is the optical frame of the wrist camera."""
GRIP_FORCE = 20.0
"""N, force of each finger while it closes"""

_HOLD_FORCE = 5.0  # N, of each finger on what is held by the constraint already
_HOLD_STRENGTH = 200.0  # N, of the constraint
_TOUCH_STEPS = 6  # with both pads in contact before the gripper holds
_LET_GO = 0.002  # m, by which the target must exceed the opening to let go
_POSITION_GAIN = 0.3


class SimulatedArm:
    """An arm of `etc/robots` at the world's origin, with two prismatic fingers.

    Args:
        world: where it stands, and whose objects it can hold.
        model: name of the URDF file, without `.urdf`.
        start: rad, joint positions; cut to the joints' limits.

    Raises:
        ConfigError: for an unknown model, one that the physics engine cannot load, one without two fingers, or a wrong
            number of positions.
    """

    def __init__(self, world: World, model: str, start: Sequence[float]) -> None:
        self._world = world
        self._bullet = world.bullet
        self.body = _load(self._bullet, model)
        """The physics engine's number of the robot."""
        joints = [self._bullet.getJointInfo(self.body, i) for i in range(self._bullet.getNumJoints(self.body))]
        self._links = {info[12].decode(): info[0] for info in joints}
        moving = [info for info in joints if info[2] == pybullet.JOINT_REVOLUTE]
        fingers = [info for info in joints if info[2] == pybullet.JOINT_PRISMATIC]
        if len(fingers) != 2 or len(moving) != len(start):
            raise ConfigError(
                f"robot {model!r} has {len(moving)} joints and {len(fingers)} fingers; "
                f"expected {len(start)} joints as in the start pose, and 2 fingers"
            )
        self.names = tuple(info[1].decode() for info in moving)
        self._joints = [info[0] for info in moving]
        self._limits = [(info[8], info[9]) if info[8] < info[9] else (-math.inf, math.inf) for info in moving]
        self._forces = [info[10] for info in moving]
        self._fingers = [info[0] for info in fingers]
        self._finger_speed = min(info[11] for info in fingers)
        self._palm = fingers[0][16]
        start = self._within_limits(start)
        self._ramp = Ramp(start, [info[11] for info in moving], STEP)
        self.widest = 2 * min(info[9] for info in fingers)
        """m, the largest opening"""
        self._target_opening = self.widest
        self._touching = 0
        self._rests = False
        self._fingers_told: tuple[float, float] | None = None
        self._may_hold = True
        self._constraint: int | None = None
        self._held: str | None = None
        self._reset(start)

    @property
    def positions(self) -> tuple[float, ...]:
        """Measured joint positions, rad."""
        return tuple(state[0] for state in self._bullet.getJointStates(self.body, self._joints))

    @property
    def velocities(self) -> tuple[float, ...]:
        """rad/s, measured."""
        return tuple(state[1] for state in self._bullet.getJointStates(self.body, self._joints))

    @property
    def opening(self) -> float:
        """Measured distance between the pads, m."""
        return float(sum(state[0] for state in self._bullet.getJointStates(self.body, self._fingers)))

    @property
    def contact(self) -> bool:
        """Both pads touch something."""
        return all(self._touched(finger) for finger in self._fingers)

    @property
    def is_driven(self) -> bool:
        """Whether the joints are on their way: to a target, along a trajectory, or to a rest."""
        return not self._ramp.is_resting

    @property
    def is_braking(self) -> bool:
        """Whether the joints come to rest because the arm was stopped."""
        return self._ramp.is_braking

    @property
    def held(self) -> str | None:
        """Name of the object in the gripper."""
        return self._held

    def move_joints(self, positions: Sequence[float], speed: float = 1.0) -> None:
        """Go to `positions` (rad, cut to the joints' limits) at `speed` (0 to 1 of theirs)."""
        self._ramp.aim(self._within_limits(positions), speed)

    def follow(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Pass through `positions` (rad, cut to the joints' limits) at `times` (s from now), and stay at the last."""
        self._ramp.follow(times, [self._within_limits(row) for row in positions])

    def move_gripper(self, opening: float) -> None:
        """Open or close to `opening` m; a held object is let go when that is wider than it is."""
        self._target_opening = min(max(opening, 0.0), self.widest)
        self._may_hold = True
        if self._held is not None and self._target_opening > self.opening + _LET_GO:
            self.let_go()

    def stop(self) -> None:
        """Come to rest within the limits of the joints; fingers that touch something go on pressing."""
        self._ramp.stop(self.positions, self.velocities)
        if self._held is None and not any(map(self._touched, self._fingers)):
            self._target_opening = self.opening

    def let_go(self) -> None:
        """Drop the held object, and hold nothing until the gripper is moved again; harmless when there is none."""
        if self._constraint is not None:
            self._bullet.removeConstraint(self._constraint)
        self._constraint = self._held = None
        self._touching = 0
        self._may_hold = False

    def step(self) -> None:
        """Prepare the next step of physics."""
        resting = self._ramp.is_resting
        if not resting:
            self._ramp.step()
        if not (resting and self._rests):  # motors keep their targets
            self._drive_joints()
        self._rests = resting
        self._drive_fingers()
        if self._held is None and self._may_hold and self._target_opening < self.opening:
            self._try_to_hold()

    def link_pose(self, name: str) -> Pose:
        """world_from_link of a link of the URDF; `ConfigError` if it has none of that name."""
        if name not in self._links:
            raise ConfigError(f"the robot has no link {name!r}; {suggest(name, self._links)}")
        return self._bullet.link_pose(self.body, self._links[name])

    def jacobian(self, link: str) -> NDArray[np.float64]:
        """(6, n) of the link's frame at the present joint positions: world m, then rad, per rad."""
        chain = [*self._joints, *self._fingers]
        where = [state[0] for state in self._bullet.getJointStates(self.body, sorted(chain))]
        zeros = [0.0] * len(where)
        state = self._bullet.getLinkState(self.body, self._links[link])
        linear, angular = self._bullet.calculateJacobian(
            self.body, self._links[link], Pose(state[2], state[3]).inverse().t, where, zeros, zeros
        )
        columns = [sorted(chain).index(joint) for joint in self._joints]
        return np.vstack([linear, angular])[:, columns]

    def camera_pose(self) -> Pose:
        """world_from_camera of the wrist camera's optical frame."""
        return self.link_pose(CAMERA_LINK)

    def _within_limits(self, positions: Sequence[float]) -> list[float]:
        return [min(max(q, low), high) for q, (low, high) in zip(positions, self._limits, strict=True)]

    def _reset(self, start: Sequence[float]) -> None:
        for joint, position in zip(self._joints, start, strict=True):
            self._bullet.resetJointState(self.body, joint, position)
        for finger in self._fingers:
            self._bullet.resetJointState(self.body, finger, self.widest / 2)

    def _drive_joints(self) -> None:
        self._bullet.setJointMotorControlArray(
            self.body,
            self._joints,
            pybullet.POSITION_CONTROL,
            targetPositions=self._ramp.positions.tolist(),
            targetVelocities=self._ramp.velocities.tolist(),
            forces=self._forces,
            positionGains=[_POSITION_GAIN] * len(self._joints),
        )

    def _drive_fingers(self) -> None:
        wanted = (self._target_opening, GRIP_FORCE if self._held is None else _HOLD_FORCE)
        if wanted == self._fingers_told:
            return
        self._fingers_told = wanted
        for finger in self._fingers:
            self._bullet.setJointMotorControl2(
                self.body,
                finger,
                pybullet.POSITION_CONTROL,
                targetPosition=wanted[0] / 2,
                force=wanted[1],
                maxVelocity=self._finger_speed,
            )

    def _touched(self, finger: int) -> set[int]:
        """Bodies that the finger touches."""
        return {contact[2] for contact in self._bullet.getContactPoints(bodyA=self.body, linkIndexA=finger)}

    def _try_to_hold(self) -> None:
        """Count the steps for which both pads have touched one object; after enough, fix it to the palm."""
        left, right = map(self._touched, self._fingers)
        names = [name for body in sorted(left & right) if (name := self._world.name_of(body)) is not None]
        self._touching = self._touching + 1 if names else 0
        if self._touching >= _TOUCH_STEPS:
            self._hold(names[0])

    def _hold(self, name: str) -> None:
        palm = self._bullet.getLinkState(self.body, self._palm, computeForwardKinematics=True)
        palm_from_object = Pose(palm[0], palm[1]).inverse() @ self._world.pose(name)
        constraint: int = self._bullet.createConstraint(
            self.body,
            self._palm,
            self._world.body(name),
            -1,
            pybullet.JOINT_FIXED,
            [0, 0, 0],
            palm_from_object.t,
            [0, 0, 0],
            palm_from_object.q,
        )
        self._bullet.changeConstraint(constraint, maxForce=_HOLD_STRENGTH)
        self._constraint, self._held = constraint, name


def _load(bullet: Bullet, model: str) -> int:
    known = {file.stem: file for file in ETC.glob("robots/*.urdf")}
    if model not in known:
        raise ConfigError(f"unknown robot model {model!r}; {suggest(model, known)}")
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    try:
        body: int = bullet.loadURDF(str(known[model]), useFixedBase=True, flags=flags)
    except pybullet.error as error:
        reason = "the physics engine cannot load it; is a mesh missing?"
        raise ConfigError(reason, file=str(known[model])) from error
    return body


TOOL_LINK = "tool_link"
"""Link of the URDF whose place the error is about."""
_DAMPING = 1e-3  # m, keeps the joints' errors small near a singularity


def displaced(arm: SimulatedArm, translation: Vector3) -> tuple[float, ...]:
    """The positions (rad) at which the tool would be `translation` m (world) from where it is, turned as it is.

    One step of damped least squares with the tool's Jacobian (Buss and Kim 2005): right to first order, that is to
    about 0.6 mm for 15 mm.
    """
    jacobian = arm.jacobian(TOOL_LINK)
    square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(6)
    change = jacobian.T @ np.linalg.solve(square, np.array([*translation, 0.0, 0.0, 0.0]))
    return tuple((np.array(arm.positions) + change).tolist())
