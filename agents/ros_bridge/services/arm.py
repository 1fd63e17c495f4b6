"""An arm that ROS controls, as a driver: FollowJointTrajectory, a gripper's action, and JointState."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from agents.drivers import ArmState
from agents.joint_ramp import ASIDE
from agents.ros_bridge.errors import RosError, RosMessageError
from agents.ros_bridge.link.actions import ActionClient
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.joints import JOINT_STATE, JointSample, JointTable, read_joints
from agents.ros_bridge.mapping.stamps import to_duration
from agents.ros_bridge.services.deadman import ALL_GOALS, FOLLOW, Deadman
from agents.ros_bridge.services.device import RosDevice
from agents.ros_bridge.services.goals import GIVEN_UP, tell_end, wait_for_end
from agents.ros_bridge.services.gripper import RosGripper
from agents.ros_bridge.services.lane import Lane
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.arms import ARM
from dsr.vocabulary.halting import HaltLatch, HaltOrder

_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
_POINT = "trajectory_msgs/msg/JointTrajectoryPoint"
_ANSWER_WITHIN = 2.0
"""s that a controller may take to accept or cancel a goal"""
_SHORTEST = 0.1
"""s of a motion to one place: controllers refuse points of now"""
_BETWEEN_DEADMEN = 5.0
"""s between two starts of the process that cancels: one that ends at once would use a whole core by starting"""
_SHOWN = 0.2
"""s for which a way that was refused is told as a fault: ten samples, that none of it is missed"""
_MOST_SAMPLES = 100
"""JointStates that wait for a tick"""


class RosArm(RosDevice):
    """An `ArmDriver`. `stop` cancels all goals of the controller, and has it hold the present position.

    The driver obeys `dsr halt` by itself, also while its agent is busy or hangs.

    Args:
        bus: where emergency stops are heard.
        keys: of the graph.
        joints: names of the arm's joints, as in its URDF and its controller.
        trajectory: FollowJointTrajectory action of the controller.
        states: topic of JointState.
        gripper: GripperCommand or ParallelGripperCommand action; empty for an arm without a gripper.
        gripper_joint: name of the joint that tells how far the gripper is open.
        gripper_closed: position of this joint, and in commands, with nothing between the pads.
        gripper_open: position of this joint, and in commands, at `stroke`.
        stroke: m between the pads at `gripper_open`.
        effort: N, greatest force of the gripper; 0 leaves it to the controller.
        deadman: s without `keep_alive` after which a process of its own cancels all goals; 0 for no such process.
        link: how ROS is reached, see `LinkConfig`.
        restamp: take the time of arrival for the stamps of ROS.
        arm: name of the arm, which `dsr halt --arm` uses.

    Raises:
        ConfigError: for options that fit no arm, and for DDS without an installed ROS to ask its actions.
    """

    def __init__(
        self, bus: Transport, keys: Keys, *, joints: Sequence[str],
        trajectory: str = "/joint_trajectory_controller/follow_joint_trajectory",
        states: str = "/joint_states", gripper: str = "", gripper_joint: str = "",
        gripper_closed: float = 0.0, gripper_open: float = 0.085, stroke: float = 0.085, effort: float = 0.0,
        deadman: float = 0.1,
        link: Mapping[str, Any] | None = None, restamp: bool = False, arm: str = ARM,
    ) -> None:  # fmt: skip
        if not joints or stroke <= 0.0 or gripper_open == gripper_closed:
            raise ConfigError(
                "an arm in ROS needs the names of its `joints`, a `stroke` above 0, "
                "and positions `gripper_open` and `gripper_closed` that differ"
            )
        if (link or {}).get("transport") == "dds" and not (link or {}).get("installed_ros"):
            raise ConfigError(
                "an arm is driven by actions, and vendors of DDS do not understand each other's requests; set "
                "`installed_ros` in `link` to the setup.bash of the robot's ROS, such as /opt/ros/jazzy/setup.bash, "
                "or start the robot's nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp"
            )
        super().__init__("/dsr_arm", link or {}, restamp)
        self._names = tuple(joints)
        self._patience, self._trajectory, self._link_options = deadman, trajectory, dict(link or {})
        self._deadman: Deadman | None = None
        self._deadman_began = 0.0
        self._gripper_joint, self._stroke = gripper_joint, stroke
        self._closed_at, self._open_at = gripper_closed, gripper_open
        self._inbox = self.inbox(states, JOINT_STATE, _MOST_SAMPLES, Qos(reliable=False, depth=_MOST_SAMPLES))
        self._table = JointTable()
        self._state: ArmState | None = None
        self._stalled = False
        self._lock = threading.Lock()
        self._motions = 0
        """Commands to the arm so far: a goal that is accepted after a later one began is cancelled"""
        self._follow = ActionClient(self.link, self.types, trajectory, FOLLOW)
        self._grip = RosGripper(self.link, self.types, self.tally, gripper, gripper_joint, effort) if gripper else None
        self._arm_lane, self._stop_lane, self._grip_lane = (Lane(f"ros-{name}") for name in ("arm", "stop", "gripper"))
        self._refused, self._refused_at = "", -math.inf
        """Why the last way was not begun, and when (s) that was"""
        self._halt = HaltLatch(bus, keys, self._obey_halt, arm)

    # ---- state

    def state(self) -> ArmState | None:
        """The newest sample, or None before the first of all joints. Its stamp is that of its oldest joint."""
        news = False
        for message in self._inbox.take():
            try:
                sample = self._read(message.cdr)
                stamp = self.stamp(sample.stamp, message.at)
                if stamp is not None:
                    self._table.add(sample, stamp)
                    news = True
            except RosMessageError as error:
                self.tally.tell("malformed", self._inbox.topic.name, f"a JointState was dropped: {error}")
        if news and all(name in self._table for name in self._names):
            self._state = self._sample(self._table.oldest(self._names))
        return self._state

    def _read(self, cdr: bytes | memoryview) -> JointSample:
        """Raises `RosMessageError` also for a joint of the arm whose position is not known: an older one is not it."""
        sample = read_joints(self.types.decode(JOINT_STATE, cdr))
        if unknown := sorted({*self._names, self._gripper_joint} & {*sample.unknown}):
            raise RosMessageError(f"the position of {unknown[0]!r} is not a number")
        return sample

    def _sample(self, stamp: float) -> ArmState:
        values = [self._table[name] for name in self._names]
        efforts = tuple(value[2] for value in values)
        return ArmState(
            stamp, self._names, tuple(value[0] for value in values), tuple(value[1] for value in values),
            self._opening(), self._stalled, self._halt.reason or self._fault(),
            efforts if all(map(math.isfinite, efforts)) else (), self._pressing(),
        )  # fmt: skip

    def _fault(self) -> str:
        """Why a way was refused just now; empty if none was."""
        return self._refused if self.clock.monotonic() - self._refused_at < _SHOWN else ""

    def _pressing(self) -> float | None:
        """N with which the gripper's joint presses, whichever way; None if nobody tells."""
        told = self._table[self._gripper_joint][2] if self._gripper_joint in self._table else math.nan
        return abs(told) if math.isfinite(told) else None

    def _opening(self) -> float:
        if self._gripper_joint not in self._table:
            return self._stroke
        share = (self._table[self._gripper_joint][0] - self._closed_at) / (self._open_at - self._closed_at)
        return min(max(share, 0.0), 1.0) * self._stroke

    # ---- commands

    def follow(self, times: tuple[float, ...], positions: tuple[tuple[float, ...], ...]) -> None:
        """Pass through joint `positions` (rad) at `times` (s from now, increasing), and stay at the last ones.

        A way that begins now, and where the arm is not by its newest sample, is refused, the arm stopped, and the
        reason told as a fault. Likewise one of numbers that are not finite. A way whose first time is later begins
        where the arm is.
        """
        if self._is_forbidden():
            return
        if wrong := self._wrong(times, positions):
            self.tally.tell("motions refused", "", f"a motion was refused: {wrong}")
            self._refused, self._refused_at = wrong, self.clock.monotonic()
            self.stop()
            return
        points = [(time, row) for time, row in zip(times, positions, strict=True) if time > 0.0]
        if not points:
            points = [(_SHORTEST, positions[-1])]
        with self._lock:
            self._motions += 1
            motion = self._motions
        self._arm_lane.do(lambda: self._send(points, motion))

    def move_gripper(self, opening: float) -> None:
        """Open or close to `opening` m between the pads."""
        grip = self._grip
        if self._is_forbidden():
            return
        if grip is None:
            self.tally.tell("no gripper", "", "this arm has no gripper action: set the option `gripper`")
            return
        share = min(max(opening / self._stroke, 0.0), 1.0)
        position = self._closed_at + share * (self._open_at - self._closed_at)
        self._stalled = False
        self._grip_lane.do(lambda: self._squeeze(grip, position))

    def stop(self) -> None:
        """Hold the present position at once: cancel all goals of the controller, then command where it is."""
        with self._lock:
            self._motions += 1
        self._stop_lane.do(self._cancel_and_hold)

    def keep_alive(self) -> None:
        """The controller lives. The first call starts the process that cancels all goals when no more calls come."""
        if self._patience <= 0.0:
            return
        now = WALL_CLOCK.monotonic()
        if self._deadman is not None and self._deadman.ended:
            text = "the process that cancels motions when this driver dies has ended: it is started again"
            self.tally.tell("deadman ended", "", text)
            if now - self._deadman_began > _BETWEEN_DEADMEN:
                self._deadman.close()
                self._deadman = None
        if self._deadman is None:
            self._deadman = Deadman(self._link_options, self._trajectory, self._patience)
            self._deadman_began = now
        self._deadman.alive()

    def close(self) -> None:
        """Stop, and leave ROS."""
        self._halt.close()
        if self._deadman is not None:
            self._deadman.close()
        for lane in (self._arm_lane, self._grip_lane, self._stop_lane):
            lane.close(_ANSWER_WITHIN)
        self._follow.close()
        if self._grip is not None:
            self._grip.close()
        super().close()

    def _wrong(self, times: Sequence[float], positions: Sequence[Sequence[float]]) -> str:
        """What is wrong with a way, in words; empty if nothing is. Without a sample nobody knows where the arm is."""
        if not all(map(math.isfinite, (*times, *itertools.chain(*positions)))):
            return "the way has numbers that are not finite"
        state = self._state
        if state is None or times[0] > 0.0:
            return ""
        away = [abs(begin - here) for begin, here in zip(positions[0], state.positions, strict=True)]
        worst = max(range(len(away)), key=away.__getitem__)
        return f"the way begins {away[worst]:.2f} rad from where {self._names[worst]} is" if away[worst] > ASIDE else ""

    def _is_forbidden(self) -> bool:
        reason = self._halt.reason
        if reason:
            self.tally.tell("motions refused", reason, f"a motion was refused: {reason}")
        return bool(reason)

    def _obey_halt(self, order: HaltOrder) -> None:
        """In the network's thread: `stop` only passes the command on."""
        if order.halted:
            self.stop()

    # ---- in the lanes' threads

    def _send(self, points: Sequence[tuple[float, Sequence[float]]], motion: int) -> None:
        if motion != self._motions:
            return
        new = self.types.new
        rows = [
            new(_POINT, positions=tuple(map(float, row)), time_from_start=to_duration(self.types, time))
            for time, row in points
        ]
        trajectory = new(_TRAJECTORY, joint_names=list(self._names), points=rows)
        try:
            goal = self._follow.send(new(f"{FOLLOW}_Goal", trajectory=trajectory), _ANSWER_WITHIN)
        except RosError as error:
            self.tally.tell(GIVEN_UP, str(error), f"a motion was not begun: {error}")
            return
        if motion != self._motions:
            goal.cancel(_ANSWER_WITHIN)
            return

        def is_over() -> bool:
            return self._arm_lane.superseded or motion != self._motions

        outcome = wait_for_end(goal, self.tally, "a motion", points[-1][0], is_over)
        if outcome is not None and not is_over():
            tell_end(outcome, self.tally, "a motion")

    def _squeeze(self, grip: RosGripper, position: float) -> None:
        try:
            self._stalled = grip.squeeze(position, _ANSWER_WITHIN, lambda: self._grip_lane.superseded)
        except RosError as error:
            self.tally.tell(GIVEN_UP, str(error), f"a motion of the gripper was not begun: {error}")

    def _cancel_and_hold(self) -> None:
        try:
            self._follow.cancel(ALL_GOALS, _ANSWER_WITHIN)
        except RosError as error:
            self.tally.tell("not stopped", "", f"the controller did not answer to a cancel: {error}")
            deadman = self._deadman
            if deadman is not None:  # it has a connection of its own
                deadman.cancel()
        state = self._state
        if state is not None:
            self._arm_lane.do(lambda motion=self._motions: self._send([(_SHORTEST, state.positions)], motion))  # type: ignore[misc]
