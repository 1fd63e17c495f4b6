"""The link over DDS, between two nodes of one process (`tests/ros` has the tests against real ROS)."""

from __future__ import annotations

import multiprocessing
import os
import secrets
import signal
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Any

import pytest

from agents.ros_bridge.errors import RosLinkError, RosMessageError
from agents.ros_bridge.link.dds.dds_link import DdsLink
from agents.ros_bridge.link.dds.returned import Returned
from agents.ros_bridge.link.link import LinkConfig, Qos, Received, Topic
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.messages.transforms import StampedTransform, decode_transforms, encode_transforms
from tests.agents.ros_bridge.samples import TYPES, image, samples
from tests.agents.ros_bridge.told import eventually

STRING, TF, IMAGE = "std_msgs/msg/String", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Image"
Connect = Callable[..., DdsLink]


@pytest.fixture
def domain() -> int:
    return 20 + secrets.randbelow(200)


@pytest.fixture
def connect(domain: int) -> Iterator[Connect]:
    opened: list[DdsLink] = []

    def join(node: str, **options: Any) -> DdsLink:
        link = open_link(LinkConfig(transport="dds", **{"domain": domain, **options}), node)
        assert isinstance(link, DdsLink)
        opened.append(link)
        return link

    yield join
    for link in opened:
        link.close()


def text(data: str) -> bytes:
    return TYPES.encode(STRING, TYPES.new(STRING, data=data))


def test_messages_arrive_whole_with_time_and_writer(connect: Connect) -> None:
    got: dict[str, list[Received]] = {name: [] for name in samples() if "/msg/" in name}
    talker, listener = connect("/talker"), connect("/listener")
    for number, (name, heard) in enumerate(got.items()):
        subscription = listener.subscribe(Topic(f"/t{number}", name), heard.append)
        publisher = talker.publisher(Topic(f"/t{number}", name))
        eventually(lambda: publisher.subscribers() and subscription.publishers())  # noqa: B023 - called at once
        sent = TYPES.encode(name, samples()[name])
        publisher.send(sent)
        (message,) = eventually(lambda: heard)  # noqa: B023
        assert bytes(message.cdr).rstrip(b"\0") == sent.rstrip(b"\0"), name
        assert message.writer == publisher.writer and message.sent is not None


def test_a_large_image_arrives(connect: Connect) -> None:
    got: list[Received] = []
    subscription = connect("/viewer").subscribe(Topic("/image", IMAGE, Qos(depth=1)), got.append)
    publisher = connect("/camera").publisher(Topic("/image", IMAGE, Qos(depth=1)))
    eventually(lambda: publisher.subscribers() and subscription.publishers())
    sent = TYPES.encode(IMAGE, image(7))
    publisher.send(sent)
    (message,) = eventually(lambda: got)
    assert message.cdr == sent


def test_late_subscribers_get_what_is_latched(connect: Connect) -> None:
    latched = Topic("/tf_static", TF, Qos(transient_local=True, depth=1))
    transform = StampedTransform(1, 2, "base", "camera", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    connect("/publisher").publisher(latched).send(encode_transforms([transform]))
    got: list[Received] = []
    connect("/late").subscribe(latched, got.append)
    (message,) = eventually(lambda: got)
    assert decode_transforms(message.cdr) == [transform]


def test_a_link_does_not_hear_itself(connect: Connect) -> None:
    link, mine, others = connect("/one"), [], []
    link.subscribe(Topic("/x", STRING), mine.append)
    publisher = link.publisher(Topic("/x", STRING))
    subscription = connect("/two").subscribe(Topic("/x", STRING), others.append)
    eventually(lambda: publisher.subscribers() == 1 and subscription.publishers())
    publisher.send(text("hello"))
    eventually(lambda: others)
    assert mine == []


def test_endpoints_have_nodes_types_and_hashes(connect: Connect) -> None:
    link = connect("/bridge")
    assert any("nobody is visible on this machine" in one for one in link.problems())
    other = connect("/arm/driver")
    publisher = other.publisher(Topic("/x", STRING, Qos(reliable=False, transient_local=True)))

    def found() -> Any:
        return [one for one in link.endpoints() if one.topic.name == "/x" and one.node and one.gid == publisher.writer]

    (seen,) = eventually(found)
    assert (seen.kind, seen.node, seen.type_hash) == ("publisher", "/arm/driver", TYPES.hash(STRING))
    assert not seen.topic.qos.reliable and seen.topic.qos.transient_local and not seen.mine
    link.subscribe(Topic("/x", STRING), lambda _: None)
    assert eventually(lambda: [one for one in link.problems() if "best effort is offered, reliable is asked" in one])
    publisher.close()
    eventually(lambda: not found())


def test_nodes_that_are_made_up_do_not_fill_the_memory(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.ros_bridge.link.dds.discovery._MOST_PARTICIPANTS", 3)
    link, liar = connect("/bridge"), connect("/liar")
    assert link._discovery is not None and liar._discovery is not None
    for number in range(6):
        liar._discovery._gid = made_up = bytes([number + 1]) * 16
        liar._discovery.tell([made_up], [])

        def is_heard(made_up: bytes = made_up) -> bool:
            link.endpoints()
            return link._discovery is not None and made_up in link._discovery._nodes

        eventually(is_heard)
    assert len(link._discovery._nodes) == 3


def test_what_it_cannot_do_is_said(connect: Connect) -> None:
    link = connect("/bridge")
    with pytest.raises(RosLinkError, match="rmw_zenoh only"):
        link.serve("/x", "std_srvs/srv/Trigger", lambda request: request)
    with pytest.raises(RosLinkError, match=r"set installed_ros to the setup\.bash"):
        link.call("/x", "std_srvs/srv/Trigger", b"", 1.0)
    with pytest.raises(RosMessageError):
        link.publisher(Topic("/x", "std_msgs/msg/Strng"))
    with pytest.raises(RosLinkError, match="domain 300: expected 0 to 232"):
        connect("/far", domain=300)
    with pytest.raises(RosLinkError, match="with another reach"):
        connect("/far", beyond_loopback=True)
    link.close()
    link.close()
    with pytest.raises(RosLinkError, match="closed"):
        link.subscribe(Topic("/x", STRING), lambda _: None)
    assert link.endpoints() == []


def test_what_a_slow_subscription_misses_is_counted_and_holds_up_nobody(connect: Connect) -> None:
    link, talker = connect("/bridge"), connect("/talker")
    slow, well, awake = [], [], threading.Event()

    def sleep(message: Received) -> None:
        slow.append(message)
        awake.wait(20.0)

    for receive in (sleep, well.append):
        link.subscribe(Topic("/x", STRING, Qos(depth=5 if receive is sleep else 100)), receive)
    publisher = talker.publisher(Topic("/x", STRING, Qos(depth=100)))
    eventually(lambda: publisher.subscribers() == 2)
    publisher.send(text("first"))
    eventually(lambda: slow)
    for number in range(40):
        publisher.send(text(str(number)))
    eventually(lambda: len(well) == 41)
    assert len(slow) == 1
    awake.set()
    eventually(lambda: len(slow) == 6)
    assert [TYPES.decode(STRING, one.cdr).data for one in slow[1:]] == ["35", "36", "37", "38", "39"]
    eventually(lambda: link.lost() == {"/x": 35})
    publisher.close()
    other = talker.publisher(Topic("/x", STRING))
    eventually(lambda: other.subscribers() == 2)
    other.send(text("last"))
    eventually(lambda: len(slow) == 7 and len(well) == 42)
    assert [link.lost() for _ in range(3)] == [{"/x": 35}] * 3, "a publisher that leaves is no lost message"


def _hear(domain: int, topic: Topic, heard: Connection) -> None:
    link = DdsLink(LinkConfig(transport="dds", domain=domain), "/stopped")
    link.subscribe(topic, lambda message: heard.send(len(message.cdr)))
    threading.Event().wait()


def test_a_subscriber_whose_process_stands_still_holds_up_nobody(domain: int, connect: Connect) -> None:
    topic = Topic("/image", IMAGE, Qos(depth=10))
    sent, got = TYPES.encode(IMAGE, image()), []
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    stopped = context.Process(target=_hear, args=(domain, topic, there), daemon=True)
    stopped.start()
    try:
        link, viewer = connect("/bridge"), connect("/viewer")
        viewer.subscribe(topic, got.append)
        publisher = link.publisher(topic)
        eventually(lambda: publisher.subscribers() == 2)
        publisher.send(sent)
        eventually(lambda: here.poll() and got)
        assert stopped.pid is not None
        os.kill(stopped.pid, signal.SIGSTOP)
        for number in range(60):  # six times as many as are kept: whoever waited for it would raise after 1 s
            publisher.send(sent)
            eventually(lambda: len(got) == 2 + number)  # noqa: B023 - called at once
        os.kill(stopped.pid, signal.SIGCONT)
        publisher.send(sent)
        eventually(lambda: len(got) == 62)
        assert publisher.subscribers() == 2, "it was there all the time"
    finally:
        stopped.kill()
        stopped.join()


def test_names_of_nodes_that_began_between_two_questions_are_known(connect: Connect) -> None:
    asking, names = connect("/asking"), {f"/node_{number}" for number in range(4)}
    for name in names:
        connect(name).publisher(Topic("/told", STRING))
    for link in (asking, connect("/late")):
        eventually(lambda: len(link._discovery.participants()) == 6)  # noqa: B023 - called at once
        eventually(lambda: names <= {one.node for one in link.endpoints()})  # noqa: B023


class Seen:
    """What is seen of a domain: participants, and those of them that tell of endpoints."""

    def __init__(self) -> None:
        self.there = self.telling = {b"a", b"b"}

    def participants(self) -> set[bytes]:
        return set(self.there)

    def with_endpoints(self) -> set[bytes]:
        return set(self.telling)


def test_who_comes_back_and_tells_nothing_is_deaf_until_it_tells() -> None:
    seen: Any = Seen()
    returned = Returned(seen)
    assert returned.deaf(0.0) == []
    seen.there = seen.telling = {b"b"}
    assert returned.deaf(1.0) == []
    seen.there = {b"a", b"b", b"new"}  # who is new may take its time
    assert returned.deaf(2.0) == [] and returned.deaf(6.9) == []
    assert returned.deaf(7.1) == [b"a"]
    seen.telling = {b"a", b"b"}
    assert returned.deaf(8.0) == []
    seen.telling = {b"b"}
    assert returned.deaf(20.0) == [], "it has told of itself since"


def test_those_who_left_for_good_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.ros_bridge.link.dds.returned._MOST_GONE", 3)
    seen: Any = Seen()
    returned = Returned(seen)
    for number in range(10):
        seen.there = {number.to_bytes(16)}
        returned.deaf(float(number))
    assert len(returned._gone) == 3
