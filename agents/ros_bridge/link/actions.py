"""A client of ROS 2 actions over any link that has services: goals, feedback, results, cancelling."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from agents.ros_bridge.errors import RosError, RosLinkError, RosMessageError
from agents.ros_bridge.link.link import Received, RosLink, Topic
from agents.ros_bridge.messages.types import RosTypes

EXECUTING, SUCCEEDED, CANCELED, ABORTED = 2, 4, 5, 6
"""Of the statuses of `action_msgs/msg/GoalStatus`"""
_CANCEL = "action_msgs/srv/CancelGoal"
_CANCELLING = "cancel_goal", _CANCEL
_UUID = "unique_identifier_msgs/msg/UUID"
_ID_BYTES = 16

Feedback = Callable[[Any], None]


class ActionOutcome(msgspec.Struct, frozen=True):
    """How a goal ended."""

    status: int
    """`SUCCEEDED`, `CANCELED` or `ABORTED`"""
    result: Any
    """Message of the action's result type"""


class ActionGoal:
    """A goal that a server accepted."""

    def __init__(self, client: ActionClient, id: bytes) -> None:
        self.id = id
        """16 bytes"""
        self._client = client

    def outcome(self, timeout: float) -> ActionOutcome:
        """Wait for the end of the goal; raises `RosTimeoutError` after `timeout` s, and may be asked again."""
        response = self._client.ask("get_result", "GetResult", timeout, goal_id=self._client.uuid(self.id))
        self._client.forget(self.id)
        return ActionOutcome(response.status, response.result)

    def is_served(self) -> bool:
        """Whether the server is visible still."""
        return self._client.is_served()

    def cancel(self, timeout: float) -> bool:
        """Ask the server to end the goal early; false if it refuses. The outcome tells when it has ended."""
        return self._client.cancel(self.id, timeout)


class ActionClient:
    """Sends goals to one action server.

    Args:
        link: the connection, over which services work.
        types: message types of the server's release of ROS 2.
        name: of the action, for example `/arm_controller/follow_joint_trajectory`.
        type: of the action, for example `control_msgs/action/FollowJointTrajectory`.

    Raises:
        RosMessageError: for a type that is not known.
    """

    def __init__(self, link: RosLink, types: RosTypes, name: str, type: str) -> None:
        self.malformed = 0
        """Feedback messages that could not be read."""
        self._link, self._types, self._name, self._type = link, types, name, type
        self._feedback: dict[bytes, Feedback] = {}
        self._lock = threading.Lock()
        topic = Topic(f"{name}/_action/feedback", f"{type}_FeedbackMessage")
        self._subscription = link.subscribe(topic, self._on_feedback)
        for service, kind in (("send_goal", f"{type}_SendGoal"), ("get_result", f"{type}_GetResult"), _CANCELLING):
            link.prepare(f"{name}/_action/{service}", kind)

    def send(self, goal: Any, timeout: float, feedback: Feedback | None = None) -> ActionGoal:
        """Send a goal and wait until the server accepts it.

        Args:
            goal: message of the action's goal type (`..._Goal`).
            timeout: s
            feedback: called with each feedback message of this goal, from a thread of the link: it must not block.

        Raises:
            RosTimeoutError: if nobody answered.
            RosLinkError: if the server rejected the goal.
            RosMessageError: if its answer is none.
        """
        id = secrets.token_bytes(_ID_BYTES)
        if feedback is not None:
            with self._lock:
                self._feedback[id] = feedback
        try:
            response = self.ask("send_goal", "SendGoal", timeout, goal_id=self.uuid(id), goal=goal)
            if not response.accepted:
                raise RosLinkError(f"{self._name} rejected the goal")
        except RosError:
            self.forget(id)
            raise
        return ActionGoal(self, id)

    def ask(self, service: str, kind: str, timeout: float, **fields: Any) -> Any:
        """Ask one of the services behind the action; gives its response. Errors as of `RosLink.call`."""
        type = f"{self._type}_{kind}"
        request = self._types.encode(f"{type}_Request", self._types.new(f"{type}_Request", **fields))
        response = self._link.call(f"{self._name}/_action/{service}", type, request, timeout)
        return self._types.decode(f"{type}_Response", response)

    def cancel(self, id: bytes, timeout: float) -> bool:
        """Ask the server to end a goal early; false if it refuses."""
        info = self._types.new("action_msgs/msg/GoalInfo", goal_id=self.uuid(id))
        request = self._types.encode(f"{_CANCEL}_Request", self._types.new(f"{_CANCEL}_Request", goal_info=info))
        response = self._link.call(f"{self._name}/_action/{_CANCELLING[0]}", _CANCEL, request, timeout)
        return bool(self._types.decode(f"{_CANCEL}_Response", response).return_code == 0)

    def is_served(self) -> bool:
        """Whether a server of the action is visible."""
        name = f"{self._name}/_action/get_result"
        return any(one.kind == "service" and one.topic.name == name for one in self._link.endpoints())

    def uuid(self, id: bytes) -> Any:
        """The id of a goal as a message."""
        return self._types.new(_UUID, uuid=np.frombuffer(id, np.uint8))

    def forget(self, id: bytes) -> None:
        """Pass on no more feedback of a goal."""
        with self._lock:
            self._feedback.pop(id, None)

    def close(self) -> None:
        """Stop listening; goals go on. Harmless when repeated."""
        self._subscription.close()
        with self._lock:
            self._feedback.clear()

    def _on_feedback(self, message: Received) -> None:
        try:
            found = self._types.decode(f"{self._type}_FeedbackMessage", message.cdr)
        except RosMessageError:
            self.malformed += 1
            return
        with self._lock:
            feedback = self._feedback.get(bytes(found.goal_id.uuid))
        if feedback is not None:
            feedback(found.feedback)
