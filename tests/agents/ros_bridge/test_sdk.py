"""Our link over rmw_zenoh against an independent client of rmw_zenoh, in a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agents.ros_bridge.link.actions import CANCELED, SUCCEEDED, ActionClient
from agents.ros_bridge.link.link import Qos, Topic
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from agents.ros_bridge.messages.transforms import StampedTransform, decode_transforms, encode_transforms
from tests.agents.ros_bridge.samples import TYPES, image, joints, plain
from tests.agents.ros_bridge.sdk_types import advertise, listen, serve_action
from tests.agents.ros_bridge.told import Told, eventually

IMAGE, JOINTS, TF = "sensor_msgs/msg/Image", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
SUM, TRIGGER = "example_interfaces/srv/AddTwoInts", "std_srvs/srv/Trigger"
FOLLOW = "control_msgs/action/FollowJointTrajectory"
Connect = Callable[..., ZenohLink]
TURNED = (0.0, 0.0, 0.0, 1.0)


def has_a_joint(message: dict[str, Any]) -> bool:
    return bool(message["name"])


def test_it_hears_what_we_send(connect: Connect, sdk: Told, topic: str) -> None:
    link = connect()
    listen(sdk, topic, JOINTS)
    publisher = link.publisher(Topic(topic, JOINTS))
    eventually(lambda: publisher.subscribers() == 1)

    def warm_up() -> Any:  # it announces itself before it listens
        publisher.send(TYPES.encode(JOINTS, joints()))
        return sdk.received(topic=topic)

    eventually(warm_up)
    for number in range(30):
        publisher.send(TYPES.encode(JOINTS, joints(number / 3)))
    got = eventually(lambda: found if len(found := [*filter(has_a_joint, sdk.received(topic=topic))]) == 30 else [])
    assert [one["position"] for one in got] == [[number / 3] for number in range(30)]
    assert got[0]["header"]["stamp"] == {"sec": 1_700_000_000, "nanosec": 123_456_789}


def test_we_hear_what_it_sends(connect: Connect, sdk: Told, topic: str) -> None:
    link, got = connect(), []
    advertise(sdk, topic, JOINTS)
    subscription = link.subscribe(Topic(topic, JOINTS, Qos(depth=30)), got.append)
    eventually(lambda: subscription.publishers() == 1)
    values = {
        "header": {"stamp": {"sec": 3, "nanosec": 4}, "frame_id": "arm"},
        "name": ["a"], "position": [0.25], "velocity": [], "effort": [],
    }  # fmt: skip
    sdk.publish(topic=topic, values=values, count=30, hz=100.0)
    eventually(lambda: len(got) == 30)
    message = TYPES.decode(JOINTS, got[-1].cdr)
    assert plain(message) == [[[3, 4], "arm"], ["a"], [0.25], [], []]
    assert len({one.writer for one in got}) == 1 and link.problems() == []
    (seen,) = [one for one in link.endpoints() if one.topic.name == topic and not one.mine]
    assert (seen.kind, seen.node, seen.topic.type, seen.type_hash) == (
        "publisher",
        "/talker",
        JOINTS,
        TYPES.hash(JOINTS),
    )


def test_it_reads_our_images(connect: Connect, sdk: Told, topic: str) -> None:
    link = connect()
    listen(sdk, topic, IMAGE)
    publisher = link.publisher(Topic(topic, IMAGE, Qos(depth=5)))
    eventually(lambda: publisher.subscribers() == 1)
    small = image()
    small.height, small.data = 4, small.data[: 4 * 640 * 3]

    def send() -> Any:
        publisher.send(TYPES.encode(IMAGE, small))
        return sdk.received(topic=topic)

    (got, *_) = eventually(send)
    assert got["data"] == small.data.tolist() and got["encoding"] == "rgb8"


def test_tf_that_was_latched_reaches_a_client_that_comes_late(connect: Connect, sdk: Told, topic: str) -> None:
    link, latched = connect(), Qos(transient_local=True, depth=1)
    publisher = link.publisher(Topic(topic, TF, latched))
    publisher.send(encode_transforms([StampedTransform(1, 2, "base", "camera", (0.5, 0.0, 1.0, *TURNED))]))
    listen(sdk, topic, TF, qos=":1:,1:,:,:,,")
    (got,) = eventually(lambda: sdk.received(topic=topic))
    assert got["transforms"][0]["child_frame_id"] == "camera"
    late = connect("/late")
    heard: list[Any] = []
    late.subscribe(Topic(topic, TF, latched), heard.append)
    (message,) = eventually(lambda: heard)
    assert decode_transforms(message.cdr)[0].pose == (0.5, 0.0, 1.0, *TURNED) and message.writer == publisher.writer


def test_it_calls_our_service(connect: Connect, sdk: Told, topic: str) -> None:
    link = connect()

    def answer(request: bytes) -> bytes:
        asked = TYPES.decode(f"{SUM}_Request", request)
        return TYPES.encode(f"{SUM}_Response", TYPES.new(f"{SUM}_Response", sum=asked.a + asked.b))

    link.serve(topic, SUM, answer)
    fields = {"name": topic, "type": SUM, "request": "int64 a\nint64 b", "response": "int64 sum"}
    ask = {**fields, "hash": TYPES.hash(SUM)}
    found = eventually(lambda: sdk.call(values={"a": 40, "b": 2}, **ask))
    assert found == {"sum": 42}


def test_we_call_its_service(connect: Connect, sdk: Told, topic: str) -> None:
    link = connect()
    sdk.serve_sums(name=topic, hash=TYPES.hash(SUM))
    request = TYPES.encode(f"{SUM}_Request", TYPES.new(f"{SUM}_Request", a=-3, b=5))
    response = TYPES.decode(f"{SUM}_Response", link.call(topic, SUM, request, 10.0))
    assert response.sum == 2


def test_we_drive_its_action(connect: Connect, sdk: Told, topic: str) -> None:
    link = connect()
    serve_action(sdk, topic, FOLLOW)
    sdk.plan(name=topic, goals=[
        {"seconds": 1.0, "result": {"error_string": "reached"}},
        {"seconds": 20.0, "stopped": {"error_string": "stopped"}},
    ])  # fmt: skip
    client, seen = ActionClient(link, TYPES, topic, FOLLOW), []
    trajectory = TYPES.new("trajectory_msgs/msg/JointTrajectory", joint_names=["joint_1"])
    goal = TYPES.new(f"{FOLLOW}_Goal", trajectory=trajectory)
    reached = client.send(goal, 10.0, seen.append).outcome(10.0)
    assert (reached.status, reached.result.error_string) == (SUCCEEDED, "reached")
    assert len(seen) > 5 and seen[0].joint_names == ["joint_1"]
    stopped = client.send(goal, 10.0)
    assert stopped.cancel(10.0)
    end = stopped.outcome(10.0)
    assert (end.status, end.result.error_string) == (CANCELED, "stopped")
    client.close()
