"""The link within a process, and the action client over it."""

from __future__ import annotations

from typing import Any

import pytest

from agents.ros_bridge.errors import RosLinkError, RosMessageError, RosTimeoutError
from agents.ros_bridge.link.actions import ABORTED, ActionClient
from agents.ros_bridge.link.link import Qos, Received, Topic
from agents.ros_bridge.link.local import LocalLink, LocalRos
from dsr.clock import ManualClock
from tests.agents.ros_bridge.samples import TYPES

STRING, GRIP = "std_msgs/msg/String", "control_msgs/action/GripperCommand"
NOW = 1_000_000_000.0


@pytest.fixture
def ros() -> LocalRos:
    return LocalRos(ManualClock(NOW))


def test_what_one_sends_the_others_have_at_once(ros: LocalRos) -> None:
    talker, listener, got = LocalLink(ros, "/talker"), LocalLink(ros, "/listener"), []
    subscription = listener.subscribe(Topic("/x", STRING), got.append)
    talker.subscribe(Topic("/x", STRING), lambda _: pytest.fail("heard itself"))
    publisher = talker.publisher(Topic("/x", STRING))
    publisher.send(b"one")
    assert got == [Received(b"one", NOW, publisher.writer)] and len(publisher.writer) == 16
    assert publisher.subscribers() == subscription.publishers() == 1
    kinds = {(one.kind, one.node, one.mine) for one in listener.endpoints()}
    assert kinds == {
        ("publisher", "/talker", False),
        ("subscriber", "/listener", True),
        ("subscriber", "/talker", False),
    }
    subscription.close()
    publisher.send(b"two")
    assert len(got) == 1
    talker.close()
    assert [one for one in listener.endpoints() if not one.mine] == [] and listener.problems() == []
    for use in (lambda: publisher.send(b"x"), lambda: talker.publisher(Topic("/x", STRING))):
        with pytest.raises(RosLinkError, match="closed"):
            use()


def test_only_what_fits_is_heard(ros: LocalRos) -> None:
    talker, listener, got = LocalLink(ros, "/talker"), LocalLink(ros, "/listener"), []
    latched = talker.publisher(Topic("/x", STRING, Qos(transient_local=True, depth=2)))
    for number in range(3):
        latched.send(b"%d" % number)
    listener.subscribe(Topic("/x", STRING, Qos(transient_local=True)), got.append)
    assert [message.cdr for message in got] == [b"1", b"2"]
    for topic in (Topic("/x", "std_msgs/msg/Header"), Topic("/y", STRING), Topic("/z", STRING)):
        listener.subscribe(topic, lambda _: pytest.fail("does not fit"))
    latched.send(b"3")
    talker.publisher(Topic("/z", STRING, Qos(reliable=False))).send(b"4")
    assert [message.cdr for message in got] == [b"1", b"2", b"3"]
    with pytest.raises(RosMessageError):
        listener.subscribe(Topic("/x", "no/msg/Such"), got.append)


class Gripper:
    """An action server of three services and a topic; ends each goal with `status`."""

    def __init__(self, link: LocalLink, accepts: bool, status: int) -> None:
        self.ids: list[bytes] = []
        self.canceled: list[bytes] = []
        self.feedback = link.publisher(Topic("/gripper/_action/feedback", f"{GRIP}_FeedbackMessage"))
        link.serve("/gripper/_action/send_goal", f"{GRIP}_SendGoal", lambda request: self._start(request, accepts))
        link.serve("/gripper/_action/get_result", f"{GRIP}_GetResult", lambda _: self._end(status))
        link.serve("/gripper/_action/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel)

    def tell(self, id: bytes, position: float) -> None:
        feedback = TYPES.new(f"{GRIP}_Feedback", position=position)
        goal_id = TYPES.new("unique_identifier_msgs/msg/UUID", uuid=list(id))
        message = TYPES.new(f"{GRIP}_FeedbackMessage", goal_id=goal_id, feedback=feedback)
        self.feedback.send(TYPES.encode(f"{GRIP}_FeedbackMessage", message))

    def _start(self, request: bytes, accepts: bool) -> bytes:
        asked = TYPES.decode(f"{GRIP}_SendGoal_Request", request)
        self.ids.append(bytes(asked.goal_id.uuid))
        self.tell(self.ids[-1], asked.goal.command.position / 2)
        self.tell(b"another goal's  ", 9.0)
        return self._response("SendGoal", accepted=accepts)

    def _end(self, status: int) -> bytes:
        result = TYPES.new(f"{GRIP}_Result", stalled=True)
        return self._response("GetResult", status=status, result=result)

    def _cancel(self, request: bytes) -> bytes:
        self.canceled.append(bytes(TYPES.decode("action_msgs/srv/CancelGoal_Request", request).goal_info.goal_id.uuid))
        return TYPES.encode("action_msgs/srv/CancelGoal_Response", TYPES.new("action_msgs/srv/CancelGoal_Response"))

    def _response(self, kind: str, **fields: Any) -> bytes:
        name = f"{GRIP}_{kind}_Response"
        return TYPES.encode(name, TYPES.new(name, **fields))


def test_goals_have_feedback_an_outcome_and_can_be_cancelled(ros: LocalRos) -> None:
    server = Gripper(LocalLink(ros, "/gripper"), True, ABORTED)
    client, seen = ActionClient(LocalLink(ros, "/bridge"), TYPES, "/gripper", GRIP), []
    goal = TYPES.new(f"{GRIP}_Goal", command=TYPES.new("control_msgs/msg/GripperCommand", position=0.08))
    sent = client.send(goal, 1.0, seen.append)
    assert server.ids == [sent.id] and [one.position for one in seen] == [0.04]
    assert sent.cancel(1.0) and server.canceled == [sent.id]
    end = sent.outcome(1.0)
    assert (end.status, end.result.stalled) == (ABORTED, True)
    server.tell(sent.id, 1.0)
    server.feedback.send(b"nonsense")
    assert len(seen) == 1 and client.malformed == 1
    client.close()


def test_a_goal_may_be_rejected_and_a_server_absent(ros: LocalRos) -> None:
    client = ActionClient(LocalLink(ros, "/bridge"), TYPES, "/gripper", GRIP)
    goal = TYPES.new(f"{GRIP}_Goal")
    with pytest.raises(RosTimeoutError, match="nobody serves /gripper/_action/send_goal"):
        client.send(goal, 0.1)
    Gripper(LocalLink(ros, "/gripper"), False, ABORTED)
    with pytest.raises(RosLinkError, match="/gripper rejected the goal"):
        client.send(goal, 1.0)


def test_a_server_that_fails_is_a_refusal(ros: LocalRos) -> None:
    LocalLink(ros, "/server").serve("/x", "std_srvs/srv/Trigger", lambda _: 1 // 0)  # type: ignore[arg-type]
    with pytest.raises(RosLinkError, match="/x refused: integer division"):
        LocalLink(ros, "/client").call("/x", "std_srvs/srv/Trigger", b"", 1.0)
