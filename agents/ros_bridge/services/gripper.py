"""A gripper that ROS controls: GripperCommand, or ParallelGripperCommand, whichever its controller offers."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.link.actions import ActionClient
from agents.ros_bridge.link.link import RosLink
from agents.ros_bridge.mapping.joints import JOINT_STATE
from agents.ros_bridge.messages.types import RosTypes
from agents.ros_bridge.services.goals import tell_end, wait_for_end
from dsr.clock import WALL_CLOCK

GRIP = "control_msgs/action/GripperCommand"
"""Of `position_controllers` in ros2_controllers, as with ros2_kortex for Humble"""
PARALLEL_GRIP = "control_msgs/action/ParallelGripperCommand"
"""Of `parallel_gripper_controller`, as with ros2_kortex for Jazzy"""
_LOOK = 0.05
"""s between two looks for the controller"""
_TAKES = 5.0
"""s in which a gripper closes or opens, its stall included"""


class RosGripper:
    """Sends goals to one gripper.

    Args:
        link: the connection.
        types: message types of the robot's release of ROS 2.
        tally: is told what the controller gives up.
        name: of the action, for example `/robotiq_gripper_controller/gripper_cmd`.
        joint: name of the gripper's joint; may be empty.
        effort: N, greatest force; 0 leaves it to the controller.
    """

    def __init__(self, link: RosLink, types: RosTypes, tally: Tally, name: str, joint: str, effort: float) -> None:
        self._link, self._types, self._tally = link, types, tally
        self._name, self._joint, self._effort = name, joint, effort
        self._clients: dict[str, ActionClient] = {}

    def squeeze(self, position: float, patience: float, is_over: Callable[[], bool]) -> bool:
        """Go to a position of the joint, and wait for the end; whether something was in the way.

        Raises:
            RosLinkError: if nobody accepts the goal within `patience` s.
        """
        type = self._offered(patience)
        if type not in self._clients:
            self._clients[type] = ActionClient(self._link, self._types, self._name, type)
        goal = self._clients[type].send(self._goal(type, position), patience)
        outcome = wait_for_end(goal, self._tally, "a motion of the gripper", _TAKES, is_over)
        if outcome is None:
            return False
        stalled = bool(outcome.result.stalled and not outcome.result.reached_goal)
        if not stalled:  # a controller that does not allow stalling aborts when it holds something
            tell_end(outcome, self._tally, "a motion of the gripper")
        return stalled

    def close(self) -> None:
        """Stop listening; harmless when repeated."""
        for client in self._clients.values():
            client.close()

    def _goal(self, type: str, position: float) -> Any:
        new = self._types.new
        if type == GRIP:
            command = new("control_msgs/msg/GripperCommand", position=position, max_effort=self._effort)
        else:
            effort = [self._effort] if self._effort else []
            command = new(JOINT_STATE, name=[self._joint], position=[position], effort=effort)
        return new(f"{type}_Goal", command=command)

    def _offered(self, patience: float) -> str:
        """The type of the action that a server offers; that of old if nobody does within `patience` s."""
        end, never = WALL_CLOCK.monotonic() + patience, threading.Event()
        while True:
            for one in self._link.endpoints():
                if one.kind == "service" and one.topic.name == f"{self._name}/_action/send_goal":
                    return PARALLEL_GRIP if one.topic.type == f"{PARALLEL_GRIP}_SendGoal" else GRIP
            if WALL_CLOCK.monotonic() >= end:
                return GRIP
            WALL_CLOCK.wait(never, _LOOK)
