"""Action nodes: starts the skill that one asks for, advances it, and says in the node how that goes."""

from __future__ import annotations

import logging
from collections.abc import Callable

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.joints import Joints
from agents.arm_controller.skills.manipulator import Manipulator
from agents.arm_controller.skills.move import look, move, observe, stop
from agents.arm_controller.skills.pick import pick
from agents.arm_controller.skills.place import place
from agents.arm_controller.skills.steps import ImpossibleError, SkillError, Steps
from dsr import Memory, Node
from dsr.errors import DsrError, suggest
from dsr.vocabulary.arms import arm_of_action
from dsr.vocabulary.intentions import DONE, ENDED, FAILED, HALT, HALTED, RUN, RUNNING

_SKILLS: dict[str, Callable[[Manipulator, Node], Steps[None]]] = {
    "pick": lambda arm, node: pick(arm, _needed(node, "target")),
    "place": lambda arm, node: place(
        arm, node.get("target", ""), _needed(node, "destination"), node.get("target_pose")
    ),
    "move": lambda arm, node: move(arm, node.get("target_pose")),
    "look": lambda arm, node: look(arm, _needed(node, "target"), node.get("target_pose")),
    "observe": lambda arm, node: observe(arm),
    "stop": lambda arm, node: stop(arm),
}


RETREAT = "stepping back"
"""Stands for the name of an action while the arm steps back for another one: no node has a name with a blank"""
RETREAT_AGAIN = 1.0
"""s between two tries to step back"""


class RunningActions:
    """Runs the skills that action nodes request of this arm, one at a time.

    Args:
        memory: holds the nodes.
        arm: what skills work with.
        config: names and default speed.
        log: tells how each action went.
    """

    def __init__(self, memory: Memory, arm: Manipulator, config: ArmControllerConfig, log: logging.Logger) -> None:
        self._memory = memory
        self._arm = arm
        self._config = config
        self._log = log
        self._watch = memory.watch(node_type="action", attribute="request")
        self._steps: Steps[None] | None = None
        self.running = ""
        """Name of the action under way."""
        self.step = ""
        """Name of its present step."""
        self._told = ""
        self._retreat_at = 0.0
        for node in memory.nodes("action"):
            if node.get("status") == RUNNING and self._is_mine(node):
                self._arm.hold_still()
                self._say(node.name, FAILED, "the arm controller was restarted")

    def tick(self, joints: Joints, *, idle: bool = True) -> None:
        """Take requests, and do a step of the action under way; an `idle` arm steps back for others without any."""
        self._arm.joints = joints
        self._take_requests(joints)
        free = idle and not self.running and joints.stamp >= self._retreat_at and not self._speed_problem()
        if free and self._arm.around.others.waits_for_us():
            self._retreat(joints)
        if self._steps is not None:
            self._advance(self._steps)

    def refuse(self, reason: str, status: str = FAILED) -> None:
        """End what is under way and what is requested with this status, because the arm cannot or must not move."""
        if self.running:
            self._end(status, reason)
        self._take_requests(None, reason, status)

    def close(self) -> None:
        """Hold still if an action is under way, and take no more requests."""
        self._watch.close()
        if self.running:
            self._arm.hold_still()

    def _take_requests(self, joints: Joints | None, refused: str = "", status: str = FAILED) -> None:
        for change in self._watch.poll():
            node = self._memory.get_node(change.name)
            if node is None or node.type != "action":
                if change.name == self.running:
                    self._end(HALTED, "")
            elif node.get("request") == HALT and node.name == self.running:
                self._end(HALTED, "")
            elif node.get("request") == RUN and node.get("status") not in (*ENDED, RUNNING) and self._is_mine(node):
                self._begin(node, joints, refused, status)

    def _retreat(self, joints: Joints) -> None:
        """Without anything to do: step back for an arm that waits for this one."""
        self._retreat_at = joints.stamp + RETREAT_AGAIN
        self.running, self.step = RETREAT, ""
        self._arm.begin(joints, self._speed())
        self._steps = _from_rest(self._arm, self._arm.right_of_way.step_back())

    def _is_mine(self, node: Node) -> bool:
        """Whether this arm is to carry out the action."""
        return arm_of_action(self._memory, node) == self._config.arm

    def _begin(self, node: Node, joints: Joints | None, refused: str, status: str) -> None:
        skill = node.get("skill", "")
        if self.running == RETREAT:
            self._end(HALTED, "")
        if skill == "stop" and self.running:
            self._end(HALTED, f"{node.name} asked to stop")
        problem = refused or self._problem(skill) or self._speed_problem()
        if problem or joints is None:
            self._say(node.name, status if refused else FAILED, problem)
            return
        self.running, self.step, self._told = node.name, "", ""
        try:
            self._arm.begin(joints, self._speed())
            steps = _SKILLS[skill](self._arm, node)
            self._steps = steps if skill == "stop" else _from_rest(self._arm, steps)
        except DsrError as error:
            self._end(FAILED, str(error), moving=False)
        else:
            self._say(node.name, RUNNING, "")

    def _problem(self, skill: str) -> str:
        """Why the action cannot begin, or nothing."""
        if self.running:
            return f"the arm is busy with {self.running}"
        if skill not in _SKILLS:
            return f"unknown skill {skill!r}; {suggest(skill, _SKILLS)}"
        return ""

    def _speed_problem(self) -> str:
        """Why the arm cannot go as fast as it should, or nothing."""
        speed = self._speed()
        return "" if 0.0 < speed <= 1.0 else f"target_speed {speed:g}: expected more than 0, at most 1"

    def _speed(self) -> float:
        node, usual = self._memory.get_node(self._config.arm), self._config.default_speed
        speed: float = usual if node is None else node.get("target_speed", usual)
        return speed

    def _advance(self, steps: Steps[None]) -> None:
        try:
            self.step = next(steps)
            self._tell_course()
        except StopIteration:
            self._end(DONE, "", moving=False)
        except DsrError as error:
            self._end(FAILED, str(error), hopeless=isinstance(error, ImpossibleError))
        except Exception as error:
            self._end(FAILED, f"unexpected {type(error).__name__}: {error}")
            raise

    def _tell_course(self) -> None:
        """Say in the action's node for whom the arm stands still, or what else it has to tell."""
        whom = self._arm.execution.waits_for
        told = f"stands still: {whom} is near" if whom else self._arm.note
        if told != self._told:
            self._told = told
            if self.running in self._memory:
                self._memory.update_node(self.running, explanation=told)

    def _end(self, status: str, explanation: str, *, moving: bool = True, hopeless: bool = False) -> None:
        name, steps = self.running, self._steps
        self.running, self.step, self._steps = "", "", None
        if steps is not None:
            steps.close()
        if moving:
            self._arm.hold_still()
        self._arm.right_of_way.withdraw()
        self._say(name, status, explanation, hopeless)

    def _say(self, name: str, status: str, explanation: str, hopeless: bool = False) -> None:
        node = self._memory.get_node(name)
        if node is None:
            return
        about = " ".join(str(node.get(part)) for part in ("skill", "target", "destination") if node.get(part))
        level = logging.WARNING if status == FAILED else logging.INFO
        self._log.log(level, "%s %s (%s)%s", name, status, about, f": {explanation}" if explanation else "")
        told = {"hopeless": hopeless} if hopeless or node.get("hopeless") else {}
        self._memory.update_node(name, status=status, explanation=explanation, **told)


def _from_rest(arm: Manipulator, steps: Steps[None]) -> Steps[None]:
    """A skill that begins when the arm has come to rest: ways are planned from where it stands."""
    yield from arm.settle()
    yield from steps


def _needed(node: Node, attribute: str) -> str:
    """The attribute of an action that cannot be without it. Raises `SkillError`."""
    value: str = node.get(attribute, "")
    if not value:
        raise SkillError(f"the action has no {attribute}")
    return value
