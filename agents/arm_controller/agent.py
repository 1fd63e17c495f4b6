"""The arm controller: joints and cameras into the graph, targets from the graph to the driver."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from msgspec.structs import replace

from agents.arm_controller.body import RobotNodes
from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.grasping.grip import GripperControl
from agents.arm_controller.grasping.holding import GraspEdges
from agents.arm_controller.grasping.pressing import GentleFingers
from agents.arm_controller.joints import Joints, JointsError, read_joints, to_driver
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.kinematics import USUAL_SPEED
from agents.arm_controller.motion.execution import MotionExecution
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.report import NO_DRIVER
from agents.arm_controller.safety.halting import EmergencyStop
from agents.arm_controller.safety.sight import Patience
from agents.arm_controller.safety.watchdog import Watchdog
from agents.arm_controller.scene import ArmScene
from agents.arm_controller.skills.actions import RunningActions
from agents.arm_controller.skills.manipulator import Manipulator
from agents.arm_controller.targets import MotionControl
from agents.camera_feed import CameraFeed
from agents.drivers import Announcing, ArmDriver, ArmState, has_option, make_driver
from dsr.agent import Access, Agent
from dsr.errors import ConfigError, suggest
from dsr.files.built_in import ETC
from dsr.network.keys import agent_of
from dsr.vocabulary.arms import ARM, CONTROLLER
from dsr.vocabulary.halting import HALT_ATTRIBUTES, HALT_NODE
from dsr.vocabulary.intentions import FAILED, HALTED
from dsr.vocabulary.intrinsics import INTRINSICS
from dsr.vocabulary.relations import MODELLED, THINGS

OBJECTS = (*THINGS, "hand", "finger", "person")
"""Types of nodes that may be in the way or in the gripper."""
START_UP = 10.0
"""s that the device may take until its first sample."""
SILENCE = 0.5
"""s without a new sample after which the driver of a slow device counts as gone, too"""
SLOWER = 1.4
"""Share of the longest interval between samples of late that a silence may last: a robot at 20 Hz is not gone"""
LATE = 0.02
"""s, all that one tick can add to a silence: several ticks find no sample before the driver counts as gone. Where this
agent itself did not run, on an overloaded machine, samples may have come that it could not see."""


class ArmController(Agent):
    """Stands between one arm with its cameras and the working memory; each arm of a graph has one of its own.

    Writes at 50 Hz the kinematic chain as RT edges, joint values and gripper opening, and forwards camera
    frames. Follows `target_joints`, `target_pose` (the tool point in the world frame) and `target_speed` of
    the arm's node and `target_opening` of the gripper's; both nodes' `status` says how that goes, and
    `explanation` why it does not.
    """

    name = CONTROLLER
    rate_hz = 50.0
    reads = Access(
        nodes=("arm", "gripper", "camera", "table", "action", "zone", HALT_NODE, *MODELLED, *OBJECTS),
        edges=("RT", "Virtual_RT", "grasping"),
        attributes=(
            *("size", "shape", "bounds", "mesh", "present", "perceived"),
            *("target_joints", "target_pose", "target_speed", "target_opening"),
            *("skill", "target", "destination", "request", "arm"),
            *("way", "way_times", "way_since", "waits_for", "gripper"),
            *HALT_ATTRIBUTES,
        ),
    )
    writes = Access(
        nodes=("world", "robot", "body", "mind", "arm", "gripper", "camera", "action", HALT_NODE),
        edges=("RT", "has", "grasping"),
        attributes=(
            *("joint_names", "joint_positions", "joint_velocities", "opening", "contact"),
            *("status", "explanation", "hopeless", "target_joints", "target_pose", "target_opening", "held_at"),
            *("bounds", "source", "since", "controller", "gripper"),
            *("way", "way_times", "way_since", "waits_for"),
            *HALT_ATTRIBUTES,
            *("stream", *INTRINSICS),
        ),
        exclusive=("joint_names", "joint_positions", "joint_velocities", "opening", "contact"),
        several=True,
    )
    publishes = ("blob/*", "device/*/command", "device/halted/*")
    Config = ArmControllerConfig
    config: ArmControllerConfig

    def setup(self) -> None:
        """Make the drivers and put the robot into the graph. Raises `ConfigError`; also if another agent moves it."""
        self._model = self.config.load_arm(ETC.parent)
        self._chain = self._model.chain
        if not self.config.observe_joints:
            self.config = replace(self.config, observe_joints=self._model.home)
        config = self.config
        if drawn_only := self._model.robot.drawn_only:
            names = ", ".join(drawn_only)
            self.log.warning("%s: drawn without a <collision>, so the arm meets nothing with: %s", config.urdf, names)
        if unlimited := [joint.name for joint in self._chain.joints if math.isinf(joint.velocity)]:
            names = ", ".join(unlimited)
            self.log.warning("%s: no velocity limit, so %g is taken, of: %s", config.urdf, USUAL_SPEED, names)
        self._check_config()
        if rival := self._rival():
            raise ConfigError(f"arm {config.arm!r} is moved by {rival!r}, which runs: give one of them another `arm`")
        self._body = RobotNodes(self.memory, self._model, config, self.name)
        self._body.build()
        self._is_late = self._was_woken = False
        """Whether the last tick found no new sample; whether the next one was asked for because of that."""
        self._driver: ArmDriver = make_driver(config.driver, self.bus, self.keys, **self._driver_options())
        if isinstance(self._driver, Announcing):
            self._driver.on_sample(self._take_late_sample)
        self._feeds: list[CameraFeed] = []
        self._make_feeds()
        self._state: ArmState | None = None
        self._heard = self._ticked = self.clock.now()
        """s, when the last sample came, later by the time in which nobody looked; when the last tick was."""
        self._gone = ""
        """Since when the arm's driver tells nothing, in words; empty if it does"""
        self._complained = False
        self._emergency = EmergencyStop(self.memory, self.bus, self.keys, self.name, self.log, config.arm)
        self._watchdog = Watchdog(self._chain, self.config.stale, self.config.effort_limits)
        self._patience = Patience(SLOWER, self.config.stale, SILENCE)
        self._obeyed = ""
        """The reason to stop that the driver was told of"""
        self._scene = ArmScene(self.memory)
        gripper_from_tool = self._model.palm_from_tool
        self._holding = GraspEdges(self.memory, self._scene, config, self._chain.forward, gripper_from_tool)
        self._fingers = GentleFingers(config.grip_limit, self._driver.move_gripper)
        manipulator = self._make_manipulator()
        self._right_of_way = manipulator.right_of_way
        self._actions = RunningActions(self.memory, manipulator, config, self.log)
        widest = self._model.gripper.widest or math.inf
        self._motion = MotionControl(
            self.memory, manipulator, self._chain, config, log=self.log, rng=np.random.default_rng(self.seed)
        )
        self._grip = GripperControl(self.memory, config, widest, self._fingers, log=self.log)

    def tick(self, now: float) -> None:
        """Forward what the devices measured since the last tick, and follow the targets."""
        joints = self._new_sample(now)
        self._is_late, self._was_woken = joints is None and not self._was_woken, False
        self._look(joints, now)
        ordered, danger = self._emergency.reason, self._watchdog.danger
        if ordered or danger:  # before all that may fail
            self._stay(ordered or danger, HALTED if ordered else FAILED)
        self._obeyed = ordered or danger
        self._emergency.tick(self._is_moving)
        if joints is not None:
            self._body.write(joints)
            self._holding.tick(joints)
            self._right_of_way.tick(joints)
            self._hear_again(joints)
        if self._gone:
            self._actions.refuse(self._gone)
        elif joints is not None and not (ordered or danger):
            self._follow_targets(joints)
        if not ordered:
            self._driver.keep_alive()  # after all that may fail: the device stops an arm whose controller is not well
        self.degraded = "; ".join(filter(None, (ordered, danger, self._gone, *(feed.trouble for feed in self._feeds))))
        self.counts = {f"{feed.node} {what}": n for feed in self._feeds for what, n in feed.counts.items()}

    def _look(self, joints: Joints | None, now: float) -> None:
        """Find out what works: cameras, memory, the driver of the arm."""
        for feed in self._feeds:
            if feed.forward():
                self._watchdog.note_frame(feed.node, now)
        self._watchdog.note_rival(self._rival(), now)
        self._watchdog.look(bool(self.memory.peers), now)
        self._heard += max(0.0, now - self._ticked - LATE)
        self._ticked = now
        if joints is not None:
            self._heard = now
            self._patience.note(now)
        silence, patience = now - self._heard, self._patience.seconds if self._state else START_UP
        if silence > patience and not (self._gone or self._watchdog.danger):
            self._gone = f"no sample of the arm for {silence:.2f} s"
            self._driver.stop()
            self._motion.report.say(NO_DRIVER, self._gone)

    def _rival(self) -> str:
        """Name of another agent that runs and moves the same arm, as its node tells; empty for none."""
        node = self.memory.get_node(self.config.arm)
        mover = self.name if node is None else node.get("controller", self.name)
        runs = mover != self.name and any(agent_of(rid) == mover for rid in self.memory.peers)
        return mover if runs else ""

    def teardown(self) -> None:
        """Stop the arm if it moves, and release the devices."""
        closers = (getattr(self, name, None) for name in ("_actions", "_motion", "_grip", "_driver", "_emergency"))
        for closer in (*closers, *getattr(self, "_feeds", ())):
            if closer is not None:
                closer.close()

    def _driver_options(self) -> dict[str, Any]:
        """As configured; a driver of several arms is told which one it is, unless it is the first."""
        config = self.config
        told = {"arm": config.arm} if config.arm != ARM and has_option(config.driver, "arm") else {}
        return {**told, **config.options}

    def _check_config(self) -> None:
        config, joints = self.config, len(self._chain)
        if config.grip_limit < 0.0:
            raise ConfigError(f"grip_limit {config.grip_limit}: expected more than 0, or 0 for none")
        if not 0.0 < config.default_speed <= 1.0:
            raise ConfigError(f"default_speed {config.default_speed}: expected more than 0, at most 1")
        for name in ("posture", "observe_joints"):
            given = len(getattr(config, name))
            if given not in (0, joints):
                raise ConfigError(f"{name} of {given} positions: expected {joints} or none")

        for name, limit in config.effort_limits.items():
            if name not in self._chain.names or limit <= 0.0:
                hint = suggest(name, self._chain.names)
                raise ConfigError(f"effort_limits: {name!r} = {limit}; expected a limit above 0 of a joint: {hint}")

    def _make_feeds(self) -> None:
        for node, camera in self.config.cameras.items():
            options = {"name": camera.name or node, **camera.options}
            driver = make_driver(camera.driver, self.bus, self.keys, **options)
            self._feeds.append(CameraFeed(self.memory, node, driver, self.log))

    def _make_manipulator(self) -> Manipulator:
        config = self.config
        figure = Figure(self._model)
        rng = np.random.default_rng([self.seed, 1])
        move, stop = self._follow_trajectory, self._driver.stop
        execution = MotionExecution(self._chain, figure, self._scene, config, move, stop)
        return Manipulator(self._chain, figure, self._scene, self._holding, self._fingers, execution, config, rng)

    def _new_sample(self, now: float) -> Joints | None:
        """The driver's newest sample if it was not seen before and describes this arm."""
        state = self._driver.state()
        if state is None or (self._state is not None and state.stamp == self._state.stamp):
            return None
        try:
            joints = self._fingers.felt(read_joints(state, self._chain.names))
            self._watchdog.note_sample(joints, "", state.fault, now)
        except JointsError as error:
            self._watchdog.note_sample(None, str(error), "", now)
            if not self._complained:
                self.log.error("samples of the arm are dropped (logged once): %s", error)
            self._complained = True
            return None
        self._state = state
        return joints

    def _take_late_sample(self) -> None:
        """Tick now for the sample that the last tick did not find: by the next one, a newer one would replace it."""
        if self._is_late:
            self._is_late, self._was_woken = False, True
            self.wake()

    @property
    def _is_moving(self) -> bool:
        """Whether a joint moved at the newest sample."""
        return self._state is not None and bool(max(map(abs, self._state.velocities)) > self.config.still_speed)

    def _hear_again(self, joints: Joints) -> None:
        """After a silence of the driver: it may have forgotten what it was told."""
        if not self._gone:
            return
        self._gone = ""
        self.log.info("samples of the arm arrive again")
        if not (self._emergency.reason or self._watchdog.danger):
            self._motion.resume(joints)
            self._grip.resume(joints)

    def _stay(self, reason: str, status: str) -> None:
        """Stop, and refuse all motion; actions end with this status."""
        if self._obeyed != reason:
            self._driver.stop()
        self._actions.refuse(reason, status)
        self._motion.forbid(reason)
        self._grip.forbid(reason)

    def _follow_targets(self, joints: Joints) -> None:
        self._fingers.tick(joints)
        self._actions.tick(joints, idle=not self._motion.is_on_the_way)
        for follower in (self._motion, self._grip):
            if self._actions.running:
                follower.give_way(self._actions.running)
            else:
                follower.tick(joints)

    def _follow_trajectory(self, trajectory: Trajectory) -> None:
        assert self._state is not None
        state, names = self._state, self._chain.names
        rows = tuple(to_driver(row, names, state) for row in trajectory.positions.tolist())
        self._driver.follow(tuple(trajectory.times.tolist()), rows)
