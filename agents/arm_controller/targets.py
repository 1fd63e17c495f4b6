"""Moves the arm to the target that its node names, and says in the node how that goes.

The arm goes straight through joint space, and not at all if something is in that way. It moves as in actions: within
the limits of velocity, acceleration and jerk, more slowly near people, and out of the ways of other arms.

The target is what is wanted, not an event: it is followed again after the driver or this process was away.
Writing `target_joints` or `target_pose` (or the same value again) is a new target and takes the other one
away; removing the target, or `target_speed` 0, stops the arm. While an action runs, targets are refused.
"""

from __future__ import annotations

import logging
import math

import numpy as np

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.joints import Joints
from agents.arm_controller.model.kinematics import JointChain, UnreachableError
from agents.arm_controller.motion.routes import BlockedError
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
)
from agents.arm_controller.skills.by_hand import go_straight
from agents.arm_controller.skills.manipulator import Manipulator
from agents.arm_controller.skills.steps import Steps
from agents.arm_controller.skills.ways import FARTHEST
from dsr import Memory, Node
from dsr.errors import DsrError, TransformError

Positions = tuple[float, ...]

LIMIT_SLACK = 0.02
"""rad beyond a limit that a target may be, because data sheets round; it is then cut to the limit"""
_TARGETS = ("target_joints", "target_pose")


class TargetError(ValueError):
    """A target that this arm cannot have."""


class MotionControl:
    """Follows the targets of one arm.

    Args:
        memory: holds the arm's node.
        arm: moves.
        chain: from the arm's base to the tool point.
        config: names and tolerances.
        log: for targets that cannot be reached.
        rng: starting points of the inverse kinematics.
    """

    def __init__(
        self,
        memory: Memory,
        arm: Manipulator,
        chain: JointChain,
        config: ArmControllerConfig,
        *,
        log: logging.Logger,
        rng: np.random.Generator,
    ) -> None:
        self.report = NodeReport(memory, config.arm, log)
        self._memory = memory
        self._arm = arm
        self._chain = chain
        self._config = config
        self._rng = rng
        self._watch = memory.watch(node_type="arm", attribute=(*_TARGETS, "target_speed"))
        self._active = ""  # the attribute that is followed
        self._steps: Steps[None] | None = None  # while on the way
        self._waits_for = ""  # whom the arm was said to stand still for
        self._yields = ("", "")  # status and explanation while something else decides over the arm

    @property
    def is_on_the_way(self) -> bool:
        """Whether the arm goes to a target, or waits until it may."""
        return self._steps is not None

    def tick(self, joints: Joints) -> None:
        """Take a new target if there is one, else see how far the arm is."""
        if self._yields[0]:
            self._yields = ("", "")
            self.report.say(IDLE)
        changes = [change for change in self._watch.poll() if change.name == self._config.arm]
        changed = frozenset[str]().union(*(change.attributes for change in changes))
        node = self._memory.get_node(self._config.arm)
        if node is not None and self._choose(node, changed):
            self._follow(node, joints)
        elif self._steps is not None:
            self._advance(self._steps)
        elif not self.report.status:
            self.report.say(IDLE)

    def give_way(self, action: str) -> None:
        """Forget the target, because an action moves the arm; call it in place of `tick` while it does.

        A target that is written meanwhile is taken away again.
        """
        self._give_up(ACTING, "", f"{action} is running")

    def forbid(self, reason: str) -> None:
        """Forget the target, because the arm must not move; call it in place of `tick` while that lasts.

        A target that is written meanwhile is taken away again: nothing moves on its own when motion is allowed again.
        """
        self._give_up(FORBIDDEN, reason, reason)

    def _give_up(self, status: str, told: str, refusal: str) -> None:
        self._watch.poll()
        node = self._memory.get_node(self._config.arm)
        written = [] if node is None else [name for name in _TARGETS if name in node]
        for name in written:
            self._memory.remove_attribute(self._config.arm, name)
        if self._yields != (status, told):
            if self._steps is not None:
                self._leave(status)
            self._active, self._steps = "", None
            self.report.say(status, told)
        elif written:
            self.report.say(REFUSED, f"{written[0]}: {refusal}")
        self._yields = (status, told)

    def _leave(self, status: str) -> None:
        """End the motion for what decides over the arm: an action, or what forbids motion and has stopped the arm."""
        if status == FORBIDDEN:
            self._arm.right_of_way.withdraw()
        elif self._arm.execution.moves:
            self._arm.hold_still()

    def resume(self, joints: Joints) -> None:
        """Follow the target again, because the driver may have forgotten it."""
        node = self._memory.get_node(self._config.arm)
        if self._active and node is not None:
            self._follow(node, joints)
        else:
            self.report.say(IDLE)

    def close(self) -> None:
        """Stop what is under way, and no longer look for targets."""
        self._watch.close()
        if self._steps is not None:
            self._arm.hold_still()

    def _choose(self, node: Node, changed: frozenset[str]) -> bool:
        """Decide which attribute is followed after those `changed`; true if it is to be followed anew."""
        written = [name for name in _TARGETS if name in changed and name in node]
        if written:
            self._active = written[0]
            for other in _TARGETS:
                if other != self._active and other in node:
                    self._memory.remove_attribute(self._config.arm, other)
            return True
        return bool(self._active) and bool(changed & {self._active, "target_speed"})

    def _follow(self, node: Node, joints: Joints) -> None:
        speed = node.get("target_speed", self._config.default_speed)
        if self._active not in node or speed == 0.0:
            if self._active not in node:
                self._active = ""
            self._halt(STOPPED)
            return
        try:
            goal = self._goal_of(node, speed, joints)
            self._arm.begin(joints, speed)
        except (TargetError, UnreachableError, TransformError) as error:
            self._halt(UNREACHABLE, f"{self._active}: {error}")
            return
        if self._arm.execution.moves:
            self._arm.hold_still()
        self._steps, self._waits_for = go_straight(self._arm, np.array(goal)), ""
        self.report.say(MOVING)
        self._advance(self._steps)

    def _goal_of(self, node: Node, speed: float, joints: Joints) -> Positions:
        """Joint positions (rad) that the node's target asks for."""
        if not 0.0 < speed <= 1.0:
            raise TargetError(f"target_speed {speed}: expected a number from 0 to 1")
        if self._active == "target_joints":
            return self._checked(node["target_joints"])
        base_from_tool = self._memory.transform(self._config.arm, "world") @ node["target_pose"]
        if (away := math.hypot(*base_from_tool.t)) > FARTHEST:
            raise TargetError(f"{away:.3g} m away")
        posture = self._config.posture or None
        return self._chain.inverse(base_from_tool, joints.positions, rng=self._rng, posture=posture).positions

    def _checked(self, positions: Positions) -> Positions:
        """The positions, cut to the limits. Raises `TargetError` if they are not for this arm."""
        chain = self._chain
        if len(positions) != len(chain):
            raise TargetError(f"{len(positions)} positions, expected {len(chain)} ({', '.join(chain.names)})")
        for joint, position in zip(chain.joints, positions, strict=True):
            if not joint.lower - LIMIT_SLACK <= position <= joint.upper + LIMIT_SLACK:
                raise TargetError(f"{position} rad for {joint.name!r}: expected {joint.lower} to {joint.upper} rad")
        cut: Positions = tuple(np.clip(positions, chain.lower, chain.upper).tolist())
        return cut

    def _halt(self, status: str, explanation: str = "") -> None:
        self._steps = None
        self._arm.hold_still()
        self.report.say(status, explanation)

    def _advance(self, steps: Steps[None]) -> None:
        """Do the next step on the way, and say for whom the arm stands still."""
        try:
            next(steps)
        except StopIteration:
            self._steps = None
            self.report.say(REACHED)
        except BlockedError as error:
            self._halt(UNREACHABLE, f"{self._active}: {error}")
        except DsrError as error:
            self._halt(STOPPED, str(error))
        except Exception as error:
            self._halt(STOPPED, f"unexpected {type(error).__name__}: {error}")
            raise
        else:
            if (whom := self._arm.execution.waits_for) != self._waits_for:
                self._waits_for = whom
                self.report.say(MOVING, f"stands still: {whom} is near" if whom else "")
