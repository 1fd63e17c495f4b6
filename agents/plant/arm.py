"""The simulated arm: joints that follow targets, and a gripper that holds an object between its pads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.arm_controller.model.arm_model import ArmModel, load_arm
from agents.arm_controller.model.kinematics import USUAL_SPEED
from agents.joint_ramp import Ramp
from agents.plant.linkage import bars_of
from agents.plant.robot_file import load_body
from agents.plant.world import STEP, World
from agents.xacro_file import Value
from dsr.errors import ConfigError, suggest
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

CAMERA_LINK = "camera_wrist_link"
"""Link of the URDF that is the optical frame of the wrist camera."""
GRIP_FORCE = 20.0
"""N, force of each finger while it closes"""

_LINKAGE_FORCE = 10.0 * GRIP_FORCE  # N at the pads, with which a bar of a linkage follows: it hardly gives
_LINKAGE_GAIN = 0.5  # share of its error that it makes good in a step
_HOLD_FORCE = 5.0  # N, of each finger on what is held by the constraint already
_HOLD_STRENGTH = 200.0  # N, of the constraint
_TOUCH_STEPS = 6  # with both pads in contact before the gripper holds
_LET_GO = 0.002  # m, by which the target must exceed the opening to let go
_POSITION_GAIN = 0.3
_USUAL_EFFORT = 100.0
"""N m or N, of a joint whose description gives no effort: as much as arms of 5 kg need at the shoulder"""


class SimulatedArm:
    """An arm with two fingers, or two groups of them on either side.

    Args:
        world: where it stands, and whose objects it can hold.
        file: its description (URDF).
        start: rad or m, joint positions; cut to the joints' limits. Its home posture if empty.
        base: world_from_base
        args: arguments of the macros of its description.

    Raises:
        ConfigError: for a description that cannot be read or that the physics engine cannot load, one without two
            fingers, or a wrong number of positions.
    """

    def __init__(
        self,
        world: World,
        file: Path,
        start: Sequence[float] = (),
        base: Pose | None = None,
        args: Mapping[str, Value] | None = None,
    ) -> None:
        self._world = world
        self._bullet = world.bullet
        self.model = load_arm(file, args=args)
        """Its joints and fingers."""
        chain, gripper = self.model.chain, self.model.gripper
        start = start or self.model.home
        sides = gripper.sides()
        if not start:
            raise ConfigError("needs joint positions to start at, or the state `home` in an SRDF file", file=str(file))
        if not all(sides) or len(chain) != len(start):
            raise ConfigError(
                f"the robot has {len(chain)} joints and fingers on {sum(map(bool, sides))} sides; "
                f"expected {len(start)} joints as in the start pose, and fingers on 2 sides",
                file=str(file),
            )
        self.body = load_body(self._bullet, file, base or Pose.identity(), args)
        """The physics engine's number of the robot."""
        infos = [self._bullet.getJointInfo(self.body, i) for i in range(self._bullet.getNumJoints(self.body))]
        self._links = {info[12].decode(): info[0] for info in infos}
        numbers = {info[1].decode(): info[0] for info in infos}
        self._free = [info[0] for info in infos if info[3] > -1]
        self.names = chain.names
        self._joints = [numbers[joint.name] for joint in chain.moving]
        self._own = [numbers[name] for name in chain.names]
        self._forces = [_given(joint.effort, _USUAL_EFFORT) for joint in chain.moving]
        self._fingers = [numbers[name] for name in gripper.names]
        self._finger_limits = _finger_limits(self.model)
        self._driven = [(numbers[joint.name], self._finger_limits[joint.name][1]) for joint in gripper.driven]
        self._bars = [(numbers[bar.joint], numbers[bar.above], bar) for bar in bars_of(self.model)]
        self._sides = [[self._links[link] for link in side] for side in sides]
        self._palm = self._links.get(self.model.palm, -1)
        start = self._within_limits(start)
        self._ramp = Ramp(start, chain.velocity.tolist(), STEP)
        self.widest = gripper.widest
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
        """Measured joint positions, rad or m."""
        return tuple(state[0] for state in self._bullet.getJointStates(self.body, self._own))

    @property
    def velocities(self) -> tuple[float, ...]:
        """rad/s or m/s, measured."""
        return tuple(state[1] for state in self._bullet.getJointStates(self.body, self._own))

    @property
    def efforts(self) -> tuple[float, ...]:
        """N m or N that the motor of each joint gave in the last step."""
        return tuple(state[3] for state in self._bullet.getJointStates(self.body, self._own))

    @property
    def opening(self) -> float:
        """Measured distance between the pads, m."""
        states = self._bullet.getJointStates(self.body, self._fingers)
        gripper = self.model.gripper
        return gripper.opening({name: state[0] for name, state in zip(gripper.names, states, strict=True)})

    @property
    def pressing(self) -> float:
        """N with which the finger that presses hardest does so: the motor's force at the pads in the last step."""
        states = self._bullet.getJointStates(self.body, [number for number, _ in self._driven])
        return max(abs(float(state[3])) / lever for state, (_, lever) in zip(states, self._driven, strict=True))

    @property
    def contact(self) -> bool:
        """Both pads touch something."""
        return all(map(self._touched, self._sides))

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

    def aside(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> tuple[str, float] | None:
        """Name of a joint that cannot come to the begin of a trajectory in time, and how far (rad) it is away; or None.

        The trajectory is as of `follow`.
        """
        found = self._ramp.aside(times, [self._within_limits(positions[0])])
        return found and (self.names[found[0]], found[1])

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
        if self._held is None and not any(map(self._touched, self._sides)):
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
        resting, braking = self._ramp.is_resting, self._ramp.is_braking
        if not resting:
            self._ramp.step()
            if braking and self._ramp.is_resting:
                self._ramp.rest(self.positions)  # something may hold it up short of where it was to come to rest
        if not (resting and self._rests):  # motors keep their targets
            self._drive_joints()
        self._rests = resting
        self._drive_fingers()
        self._drive_linkage()
        if self._held is None and self._may_hold and self._target_opening < self.opening:
            self._try_to_hold()

    def link_pose(self, name: str) -> Pose:
        """world_from_link of a link of the URDF; `ConfigError` if it has none of that name."""
        if name not in self._links:
            raise ConfigError(f"the robot has no link {name!r}; {suggest(name, self._links)}")
        return self._bullet.link_pose(self.body, self._links[name])

    def jacobian(self, link: str) -> NDArray[np.float64]:
        """(6, n) of the link's frame at the present joint positions: world m, then rad, per rad or m."""
        where = [state[0] for state in self._bullet.getJointStates(self.body, self._free)]
        zeros = [0.0] * len(where)
        state = self._bullet.getLinkState(self.body, self._links[link])
        linear, angular = self._bullet.calculateJacobian(
            self.body, self._links[link], Pose(state[2], state[3]).inverse().t, where, zeros, zeros
        )
        columns = [self._free.index(joint) for joint in self._joints]
        return np.asarray(np.vstack([linear, angular])[:, columns] @ self.model.chain.gears)

    def camera_pose(self) -> Pose:
        """world_from_camera of the wrist camera's optical frame."""
        return self.link_pose(CAMERA_LINK)

    @property
    def has_camera(self) -> bool:
        """Whether it carries a camera at the wrist."""
        return CAMERA_LINK in self._links

    def _within_limits(self, positions: Sequence[float]) -> list[float]:
        chain = self.model.chain
        cut: list[float] = np.clip(positions, chain.lower, chain.upper).tolist()
        return cut

    def _reset(self, start: Sequence[float]) -> None:
        for joint, position in zip(self._joints, self.model.chain.all_positions(start), strict=True):
            self._bullet.resetJointState(self.body, joint, position)
        for finger, position in zip(self._fingers, self.model.gripper.positions(self.widest).values(), strict=True):
            self._bullet.resetJointState(self.body, finger, position)

    def _drive_joints(self) -> None:
        chain = self.model.chain
        self._bullet.setJointMotorControlArray(
            self.body,
            self._joints,
            pybullet.POSITION_CONTROL,
            targetPositions=chain.all_positions(self._ramp.positions).tolist(),
            targetVelocities=(chain.gears @ self._ramp.velocities).tolist(),
            forces=self._forces,
            positionGains=[_POSITION_GAIN] * len(self._joints),
        )

    def _drive_fingers(self) -> None:
        wanted = (self._target_opening, GRIP_FORCE if self._held is None else _HOLD_FORCE)
        if wanted == self._fingers_told:
            return
        self._fingers_told = wanted
        positions = self.model.gripper.positions(wanted[0])
        bars = [number for number, _, _ in self._bars]
        for finger, name in zip(self._fingers, self.model.gripper.names, strict=True):
            if finger in bars:
                continue
            speed, lever = self._finger_limits[name]
            self._bullet.setJointMotorControl2(
                self.body,
                finger,
                pybullet.POSITION_CONTROL,
                targetPosition=positions[name],
                force=wanted[1] * lever,
                maxVelocity=speed,
            )

    def _drive_linkage(self) -> None:
        """Have the bars of a linkage follow the joint above them, as it was measured."""
        for number, above, bar in self._bars:
            position, velocity = self._bullet.getJointState(self.body, above)[:2]
            self._bullet.setJointMotorControl2(
                self.body,
                number,
                pybullet.POSITION_CONTROL,
                targetPosition=bar.factor * position + bar.offset,
                targetVelocity=bar.factor * velocity,
                positionGain=_LINKAGE_GAIN,
                velocityGain=1.0,
                force=_LINKAGE_FORCE * self._finger_limits[bar.joint][1],
            )

    def _touched(self, links: Sequence[int]) -> set[int]:
        """Bodies that the fingers of a side touch."""
        points = [self._bullet.getContactPoints(bodyA=self.body, linkIndexA=link) for link in links]
        return {contact[2] for found in points for contact in found} - {self.body}

    def _try_to_hold(self) -> None:
        """Count the steps for which both pads have touched one object; after enough, fix it to the palm."""
        left, right = map(self._touched, self._sides)
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


def _given(limit: float, usual: float) -> float:
    return limit if math.isfinite(limit) else usual


def _finger_limits(model: ArmModel) -> dict[str, tuple[float, float]]:
    """Speed (rad/s or m/s) of each joint of the fingers, so that all arrive at once, and m of torque for each force."""
    gripper, joints = model.gripper, {joint.name: joint for joint in model.robot.joints}
    closed, wide = gripper.positions(0.0), gripper.positions(gripper.widest)
    ways = {name: abs(wide[name] - closed[name]) for name in gripper.names}
    seconds = max(way / _given(joints[name].velocity, USUAL_SPEED) for name, way in ways.items())
    return {
        name: (way / seconds, 1.0 if joints[name].kind == "prismatic" else gripper.lever(joints[name]))
        for name, way in ways.items()
    }


_DAMPING = 1e-3  # m, keeps the joints' errors small near a singularity


def displaced(arm: SimulatedArm, translation: Vector3) -> tuple[float, ...]:
    """The positions (rad) at which the tool would be `translation` m (world) from where it is, turned as it is.

    One step of damped least squares with the tool's Jacobian (Buss and Kim 2005): right to first order, that is to
    about 0.6 mm for 15 mm.
    """
    jacobian = arm.jacobian(arm.model.tool)
    square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(6)
    change = jacobian.T @ np.linalg.solve(square, np.array([*translation, 0.0, 0.0, 0.0]))
    return tuple((np.array(arm.positions) + change).tolist())
