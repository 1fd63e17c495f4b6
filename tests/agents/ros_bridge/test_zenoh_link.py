"""The link over rmw_zenoh: loopback, discovery, QoS, what does not match, a router that goes, floods."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from agents.ros_bridge.errors import RosLinkError, RosMessageError, RosTimeoutError
from agents.ros_bridge.link.link import LinkConfig, Qos, Received, Topic
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.link.zenoh import session as session_module
from agents.ros_bridge.link.zenoh.tokens import attachment
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.samples import TYPES
from tests.agents.ros_bridge.told import eventually

STRING, TRIGGER = "std_msgs/msg/String", "std_srvs/srv/Trigger"
Connect = Callable[..., ZenohLink]


def text(data: str) -> bytes:
    return TYPES.encode(STRING, TYPES.new(STRING, data=data))


def read(message: Received) -> str:
    return str(TYPES.decode(STRING, message.cdr).data)


def pair(connect: Connect, topic: Topic) -> tuple[Any, Any, list[Received]]:
    """A publisher and a subscription of two nodes that have found each other, and what arrives."""
    got: list[Received] = []
    publisher, subscription = connect("/talker").publisher(topic), connect("/listener").subscribe(topic, got.append)
    eventually(lambda: publisher.subscribers() and subscription.publishers())
    return publisher, subscription, got


def test_messages_arrive_in_order_with_times_and_writer(connect: Connect, topic: str) -> None:
    publisher, _, got = pair(connect, Topic(topic, STRING, Qos(depth=100)))
    for number in range(100):
        publisher.send(text(str(number)))
    eventually(lambda: len(got) == 100)
    assert [read(message) for message in got] == [str(number) for number in range(100)]
    assert {message.writer for message in got} == {publisher.writer} and len(publisher.writer) == 16
    times = [message.sent for message in got if message.sent is not None]
    assert times == sorted(times) and len(times) == 100


def test_a_link_does_not_hear_itself(connect: Connect, topic: str) -> None:
    link, mine, others = connect("/one"), [], []
    link.subscribe(Topic(topic, STRING), mine.append)
    publisher = link.publisher(Topic(topic, STRING))
    connect("/two").subscribe(Topic(topic, STRING), others.append)
    eventually(lambda: publisher.subscribers() == 1)
    publisher.send(text("hello"))
    eventually(lambda: others)
    assert mine == []


def test_late_subscribers_get_the_newest_of_each_publisher(connect: Connect, topic: str) -> None:
    latched = Topic(topic, STRING, Qos(transient_local=True, depth=2))
    for name in ("/one", "/two"):
        publisher = connect(name).publisher(latched)
        for number in range(4):
            publisher.send(text(f"{name} {number}"))
    got: list[Received] = []
    connect("/late").subscribe(Topic(topic, STRING, Qos(transient_local=True, depth=10)), got.append)
    eventually(lambda: len(got) == 4)
    assert sorted(map(read, got)) == ["/one 2", "/one 3", "/two 2", "/two 3"]


def test_endpoints_and_their_end_are_visible(connect: Connect, topic: str) -> None:
    watcher, other = connect("/watcher"), connect("/arm/driver")
    qos = Qos(reliable=False, transient_local=True, depth=7)
    publisher = other.publisher(Topic(topic, STRING, qos))
    served = other.serve(f"{topic}_service", TRIGGER, lambda request: request)
    found = eventually(lambda: seen if len(seen := [one for one in watcher.endpoints() if not one.mine]) == 2 else [])
    by_kind = {one.kind: one for one in found}
    assert by_kind["publisher"].topic == Topic(topic, STRING, qos) and by_kind["publisher"].gid == publisher.writer
    assert by_kind["service"].node == "/arm/driver" and by_kind["service"].type_hash == TYPES.hash(TRIGGER)
    publisher.close()
    publisher.close()
    served.close()
    eventually(lambda: not [one for one in watcher.endpoints() if not one.mine])
    with pytest.raises(RosLinkError, match="closed"):
        publisher.send(text("too late"))


def test_types_and_names_that_are_not_known_are_refused(connect: Connect) -> None:
    link = connect()
    with pytest.raises(RosMessageError, match=r"no type of ROS 2 jazzy is called 'std_msgs/msg/Strng'.*String"):
        link.subscribe(Topic("/x", "std_msgs/msg/Strng"), lambda _: None)
    with pytest.raises(RosMessageError, match="no absolute name"):
        link.publisher(Topic("x y", STRING))
    with pytest.raises(RosMessageError, match=r"jazy.*did you mean 'jazzy'"):
        connect(distro="jazy")


def test_other_types_hashes_and_domains_are_told(connect: Connect, topic: str) -> None:
    link = connect("/bridge")
    link.subscribe(Topic(topic, STRING), lambda _: None)
    connect("/driver").publisher(Topic(topic, "std_msgs/msg/Header"))
    old = connect("/old_driver", distro="humble")
    old.publisher(Topic(topic, STRING))
    told = eventually(lambda: found if (found := "\n".join(link.problems())).count("hear each other") == 2 else "")
    assert f"/driver has {topic} as std_msgs/msg/Header, we as std_msgs/msg/String: they do not" in told
    assert f"/old_driver has {topic} as std_msgs/msg/String with another definition (TypeHashNotSupported)" in told
    alone = connect("/alone", domain=5)
    assert eventually(lambda: [one for one in alone.problems() if "nobody is visible in domain 5, but 3 nodes" in one])


def test_services_answer_refuse_and_time_out(connect: Connect, topic: str) -> None:
    server, client = connect("/server"), connect("/client")
    request = TYPES.encode(f"{TRIGGER}_Request", TYPES.new(f"{TRIGGER}_Request"))

    def answer(asked: bytes) -> bytes:
        TYPES.decode(f"{TRIGGER}_Request", asked)
        return TYPES.encode(f"{TRIGGER}_Response", TYPES.new(f"{TRIGGER}_Response", success=True))

    with pytest.raises(RosTimeoutError, match=f"nobody serves {topic}"):
        client.call(topic, TRIGGER, request, 0.1)
    served = server.serve(topic, TRIGGER, answer)
    assert TYPES.decode(f"{TRIGGER}_Response", client.call(topic, TRIGGER, request, 10.0)).success
    with pytest.raises(RosLinkError, match="refused: 2 bytes are no std_srvs/srv/Trigger_Request"):
        client.call(topic, TRIGGER, b"xx", 10.0)
    assert served.refused == 1

    held = threading.Event()

    def slow(_: bytes) -> bytes:
        held.wait(5.0)
        return b""

    server.serve(f"{topic}_slow", TRIGGER, slow)
    eventually(lambda: [one for one in client.endpoints() if one.topic.name == f"{topic}_slow"])
    with pytest.raises(RosTimeoutError, match="did not answer within"):
        client.call(f"{topic}_slow", TRIGGER, request, 0.3)
    held.set()


def test_a_request_without_attachment_is_refused(connect: Connect, topic: str) -> None:
    link = connect("/server")
    served = link.serve(topic, TRIGGER, lambda request: request)
    asker = connect("/asker")
    eventually(lambda: [one for one in asker.endpoints() if one.kind == "service"])
    key = f"0{topic}/std_srvs::srv::dds_::Trigger_/{TYPES.hash(TRIGGER)}"
    (reply,) = asker._session.get(key, payload=b"x", timeout=5.0)
    assert reply.err is not None and "no attachment" in reply.err.payload.to_string() and served.refused == 1


def test_messages_without_attachment_are_counted_and_dropped(
    connect: Connect, topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, got = connect("/listener"), []
    subscription = link.subscribe(Topic(topic, STRING), got.append)
    stranger = connect("/stranger")
    eventually(lambda: [one for one in stranger.endpoints() if one.kind == "subscriber"])
    key = f"0{topic}/std_msgs::msg::dds_::String_/{TYPES.hash(STRING)}"
    for sent in (None, b"", b"x" * 33, b"x" * 1000):
        stranger._session.put(key, b"\0\1\0\0", attachment=sent)
    stranger._session.put(key, text("right"), attachment=attachment(1, 5 * 10**9, b"g" * 16))
    eventually(lambda: got)
    assert (read(got[0]), got[0].sent, got[0].writer) == ("right", 5.0, b"g" * 16)
    assert subscription.malformed == 4
    assert any("4 messages" in problem and topic in problem for problem in link.problems())
    monkeypatch.setattr("agents.ros_bridge.link.telling._SHOWN", 0.2)
    eventually(lambda: link.problems() == [])
    stranger._session.put(key, b"\0\1\0\0", attachment=b"")
    eventually(lambda: any("5 messages" in problem for problem in link.problems()))


def test_messages_of_an_old_rmw_zenoh_are_told_as_such(connect: Connect, topic: str) -> None:
    """Up to 0.2.3 (Jazzy) a name stood before each number: rmw_zenoh's pull request 601."""
    link = connect("/listener")
    link.subscribe(Topic(topic, STRING), lambda _: None)
    stranger = connect("/stranger")
    eventually(lambda: [one for one in stranger.endpoints() if one.kind == "subscriber"])
    old = b"".join(bytes([len(name)]) + name + value for name, value in (
        (b"sequence_number", (1).to_bytes(8, "little")), (b"source_timestamp", (5).to_bytes(8, "little")),
        (b"source_gid", bytes([16]) + b"g" * 16),
    ))  # fmt: skip
    key = f"0{topic}/std_msgs::msg::dds_::String_/{TYPES.hash(STRING)}"
    stranger._session.put(key, text("old"), attachment=old)
    (problem,) = eventually(link.problems)
    assert f"1 messages of {topic} came from an rmw_zenoh older than 0.2.4 (Jazzy)" in problem


def test_a_handler_that_fails_loses_only_its_message(
    connect: Connect, topic: str, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[str] = []

    def receive(message: Received) -> None:
        got.append(read(message))
        if len(got) < 3:
            raise ValueError("no such frame")

    publisher = connect("/talker").publisher(Topic(topic, STRING))
    subscription = connect("/listener").subscribe(Topic(topic, STRING), receive)
    eventually(lambda: publisher.subscribers() and subscription.publishers())
    for number in range(5):
        publisher.send(text(str(number)))
    eventually(lambda: len(got) == 5)
    assert subscription.failures == 2 and caplog.text.count("could not be handled") == 1


def test_a_slow_subscriber_holds_up_nobody_and_its_loss_is_counted(connect: Connect, topic: str) -> None:
    go, slow_got, fast_got = threading.Event(), [], []

    def slow(message: Received) -> None:
        slow_got.append(message)
        go.wait(30.0)

    publisher = connect("/talker").publisher(Topic(topic, STRING, Qos(depth=1000)))
    listener = connect("/slow")
    subscription = listener.subscribe(Topic(topic, STRING, Qos(depth=5)), slow)
    connect("/fast").subscribe(Topic(topic, STRING, Qos(depth=1000)), fast_got.append)
    eventually(lambda: publisher.subscribers() == 2 and subscription.publishers())
    publisher.send(text("0"))
    eventually(lambda: slow_got)
    for number in range(1, 1000):
        publisher.send(text(str(number)))
    eventually(lambda: len(fast_got) == 1000)
    go.set()
    eventually(lambda: slow_got and read(slow_got[-1]) == "999")
    assert len(slow_got) < 100 and subscription.lost == 1000 - len(slow_got)
    lost = subscription.lost
    assert listener.lost() == {topic: lost} and listener.problems() == []
    subscription.close()
    listener.subscribe(Topic(topic, STRING), lambda _: None)
    assert listener.lost() == {topic: lost}, "also of a subscription that was taken back"


def test_a_router_that_is_joined_with_others_is_told(router: Router, connect: Connect) -> None:
    """A link over another interface: who is there speaks through the router, although the router is here."""
    link = connect()
    assert link.unauthenticated() == [
        f"whoever reaches the Zenoh router {router.endpoint} may speak in domain 0, in the name of any node"
    ]
    page = {"sessions": [
        {"links": [{"dst": "tcp/127.0.0.1:40000"}, {"dst": "tcp/[::1]:4"}]}, {"links": [{"dst": "tcp/192.0.2.7:7447"}]}
    ]}  # fmt: skip
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')  # a peer is reached over any interface, and the link hears loopback alone
    config.insert_json5("connect/endpoints", json.dumps([router.endpoint]))
    with zenoh.open(config) as other:
        pages = (json.dumps(page), "[]", "{", "x" * 2_000_000)
        served = [
            other.declare_queryable(f"@/{number}/router", lambda query, text=text: query.reply(query.key_expr, text))
            for number, text in enumerate(pages)
        ]
        joined = f"the router {router.endpoint} is joined with tcp/192.0.2.7:7447: it passes on what comes from there"
        eventually(lambda: link.unauthenticated()[1:] == [joined])
        assert served


def test_a_flood_of_announcements_is_bounded(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.ros_bridge.link.zenoh.discovery._MOST_TOKENS", 50)
    link, flooder = connect("/bridge"), connect("/flooder")
    live = flooder._session.liveliness()
    tokens = [live.declare_token(f"@ros2_lv/0/x/0/{number}/NN/%/%/n{number}") for number in range(100)]
    tokens += [live.declare_token(f"@ros2_lv/0/{number}") for number in range(10)]
    told = eventually(lambda: [one for one in link.problems() if "were ignored" in one and int(one.split()[0]) >= 60])
    assert len(told) == 1 and len(link._discovery.entities()) <= 50


def test_what_is_told_of_announcements_is_bounded(connect: Connect, topic: str) -> None:
    link, flooder = connect("/bridge"), connect("/flooder")
    link.subscribe(Topic(topic, STRING), lambda _: None)
    live, name = flooder._session.liveliness(), topic.replace("/", "%")
    tokens = [
        live.declare_token(
            f"@ros2_lv/0/f{number}/0/9/MP/%/%/n{number}/{name}/std_msgs::msg::dds_::Int8_/H/::,10:,:,:,,"
        )
        for number in range(100)
    ]
    tokens.append(live.declare_token(f"@ros2_lv/0/x/0/9/NN/%/%/{'n' * 5000}"))
    eventually(lambda: len(link.problems()) >= 21 and link._discovery.ignored)
    found = link.problems()
    assert "and 80 more of this kind" in found and len(found) == 22
    assert max(map(len, found)) < 300


def test_numbers_that_no_publisher_has_are_no_loss(connect: Connect, topic: str) -> None:
    """A few messages would else make counts of more than 64 bits, which no status can hold."""
    link, got = connect("/listener"), []
    link.subscribe(Topic(topic, STRING, Qos(depth=100)), got.append)
    stranger = connect("/stranger")
    eventually(lambda: [one for one in stranger.endpoints() if one.kind == "subscriber"])
    key = f"0{topic}/std_msgs::msg::dds_::String_/{TYPES.hash(STRING)}"
    numbers = [1, 2**63 - 1, -(2**63), 5, 8]
    for writer in (b"a" * 16, b"b" * 16, b"c" * 16):
        for number in numbers:
            stranger._session.put(key, text("x"), attachment=attachment(number, 0, writer))
    eventually(lambda: len(got) == 3 * len(numbers))
    assert link.lost() == {topic: 3 * 2}


def test_a_router_that_goes_and_comes_back(connect: Connect, router: Router, topic: str) -> None:
    publisher, _, got = pair(connect, Topic(topic, STRING, Qos(depth=100)))
    router.stop()
    link = connect("/newcomer")
    eventually(lambda: any("no Zenoh router answers at" in one for one in link.problems()))
    publisher.send(text("without a router"))  # between nodes that know each other
    eventually(lambda: "without a router" in map(read, got))
    late: list[Received] = []
    subscription = link.subscribe(Topic(topic, STRING), late.append)
    router.start()
    eventually(lambda: subscription.publishers() == 1 and publisher.subscribers() == 2)
    publisher.send(text("again"))
    eventually(lambda: "again" in map(read, late) and "again" in map(read, got))
    assert [read(message) for message in got].count("again") == 1
    assert link.problems() == []


def test_a_link_begins_without_a_router_and_finds_it_later(connect: Connect, router: Router, topic: str) -> None:
    router.stop()
    publisher, got = connect("/talker").publisher(Topic(topic, STRING, Qos(transient_local=True, depth=1))), []
    publisher.send(text("early"))
    connect("/listener").subscribe(Topic(topic, STRING, Qos(transient_local=True, depth=1)), got.append)
    router.start()
    eventually(lambda: got)
    assert read(got[0]) == "early"


def test_other_machines_are_out_of_reach_by_default(connect: Connect) -> None:
    with pytest.raises(RosLinkError, match=r"192\.0\.2\.7.*not authenticated.*beyond_loopback"):
        connect(router="tcp/192.0.2.7:7447")
    with pytest.raises(RosLinkError, match="expected PROTOCOL/HOST:PORT"):
        connect(router="localhost:7447")


def test_links_of_other_interfaces_carry_nothing(connect: Connect, topic: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loopback interface stands for another one: its name is taken out of the list of those allowed."""
    elsewhere = {**session_module._LOOPBACK_ONLY, "subjects": [{"id": "here", "interfaces": ["another0"]}]}
    talker = connect("/talker").publisher(Topic(topic, STRING))
    hears: list[Received] = []
    connect("/allowed").subscribe(Topic(topic, STRING), hears.append)
    monkeypatch.setattr(session_module, "_LOOPBACK_ONLY", elsewhere)
    deaf: list[Received] = []
    outside = connect("/outside")
    outside.subscribe(Topic(topic, STRING), deaf.append)
    eventually(lambda: talker.subscribers() == 1)
    for _ in range(5):
        talker.send(text("secret"))
    eventually(lambda: len(hears) == 5)
    assert deaf == [] and talker.subscribers() == 1 and all(one.mine for one in outside.endpoints())


def test_close_leaves_nothing(router: Router, topic: str) -> None:
    before = set(threading.enumerate())
    link = open_link(LinkConfig(router=router.endpoint), "/dsr/bridge")
    link.subscribe(Topic(topic, STRING), lambda _: None)
    link.publisher(Topic(topic, STRING)).send(text("x"))
    link.serve(f"{topic}_service", TRIGGER, lambda request: request)
    link.close()
    link.close()
    eventually(lambda: set(threading.enumerate()) <= before)  # Zenoh's own thread of callbacks ends a moment later
    with pytest.raises(RosLinkError, match="closed"):
        link.publisher(Topic(topic, STRING))


def test_zenoh_keeps_its_own_error_out_of_the_interface(connect: Connect, topic: str) -> None:
    link = connect()
    publisher = link.publisher(Topic(topic, STRING))
    link._session.close()
    with pytest.raises(RosLinkError, match="cannot publish"):
        publisher.send(text("x"))
    assert not isinstance(RosLinkError("x"), zenoh.ZError)
