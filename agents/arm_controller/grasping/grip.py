"""Opens and closes the gripper to the opening that its node names, and says in the node how that goes."""

from __future__ import annotations

import logging

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.grasping.pressing import GentleFingers
from agents.arm_controller.joints import Joints
from agents.arm_controller.report import (
    ACTING,
    FORBIDDEN,
    IDLE,
    MOVING,
    REACHED,
    REFUSED,
    STOPPED,
    UNREACHABLE,
    NodeReport,
    StallDetector,
)
from dsr import Memory

_STILL = 0.0002  # m per sample; less is no motion
_SLACK = 1e-6  # m


class GripperControl:
    """Follows `target_opening` of one gripper.

    Fingers that stand still before the opening is reached, for example at an object, are `stopped`.

    Args:
        memory: holds the gripper's node.
        config: names and tolerances.
        widest: m, the largest opening.
        fingers: moves them.
        log: for openings that cannot be reached.
    """

    def __init__(
        self,
        memory: Memory,
        config: ArmControllerConfig,
        widest: float,
        fingers: GentleFingers,
        *,
        log: logging.Logger,
    ) -> None:
        self.report = NodeReport(memory, config.gripper, log)
        self._memory = memory
        self._config = config
        self._widest = widest
        self._fingers = fingers
        self._watch = memory.watch(node_type="gripper", attribute="target_opening")
        self._stall = StallDetector()
        self._goal: float | None = None
        self._last = 0.0
        self._yields = ("", "")  # status and explanation while something else decides over the gripper

    def tick(self, joints: Joints) -> None:
        """Take a new opening if there is one, else see how far the fingers are."""
        if self._yields[0]:
            self._yields = ("", "")
            self.report.say(IDLE)
        changed = any(change.name == self._config.gripper for change in self._watch.poll())
        if changed:
            self._follow(joints)
        elif self._goal is not None:
            self._supervise(self._goal, joints)
        elif not self.report.status:
            self.report.say(IDLE)
        self._last = joints.opening

    def give_way(self, action: str) -> None:
        """Forget the opening, because an action moves the gripper; call it in place of `tick` while it does.

        One that is written meanwhile is taken away again.
        """
        self._give_up(ACTING, "", f"{action} is running")

    def forbid(self, reason: str) -> None:
        """Forget the opening, because nothing must move; call it in place of `tick` while that lasts."""
        self._give_up(FORBIDDEN, reason, reason)

    def _give_up(self, status: str, told: str, refusal: str) -> None:
        self._watch.poll()
        node = self._memory.get_node(self._config.gripper)
        written = node is not None and "target_opening" in node
        if written:
            self._memory.remove_attribute(self._config.gripper, "target_opening")
        if self._yields != (status, told):
            self._goal = None
            self.report.say(status, told)
        elif written:
            self.report.say(REFUSED, f"target_opening: {refusal}")
        self._yields = (status, told)

    def resume(self, joints: Joints) -> None:
        """Follow the opening again, because the driver may have forgotten it."""
        self.report.say(IDLE)
        self._follow(joints)

    def close(self) -> None:
        """No longer look for targets."""
        self._watch.close()

    def _follow(self, joints: Joints) -> None:
        node = self._memory.get_node(self._config.gripper)
        opening = None if node is None else node.get("target_opening")
        self._goal = None
        self._stall.reset()
        if opening is None:
            return
        if not -_SLACK <= opening <= self._widest + _SLACK:
            self.report.say(UNREACHABLE, f"target_opening {opening} m: expected 0 to {self._widest} m")
            return
        if opening < joints.opening and (problem := self._fingers.problem(joints)):
            self.report.say(UNREACHABLE, f"target_opening: {problem}")
            return
        self._goal = min(max(opening, 0.0), self._widest)
        self._fingers.move(self._goal, joints)
        self.report.say(MOVING)

    def _supervise(self, goal: float, joints: Joints) -> None:
        moving = abs(joints.opening - self._last) > _STILL
        if abs(joints.opening - goal) <= self._config.opening_tolerance:
            self._goal = None
            self.report.say(REACHED)
        elif self._stall.is_stalled(moving, joints.stamp):
            self._goal = None
            self.report.say(STOPPED, self._fingers.problem(joints))
