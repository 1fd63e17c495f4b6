"""Topics between rclpy (Fast DDS) and our link over DDS, both ways."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from agents.ros_bridge.bridge.core import SENSOR
from agents.ros_bridge.errors import RosLinkError
from agents.ros_bridge.link.actions import ActionClient
from agents.ros_bridge.link.dds.dds_link import DdsLink
from agents.ros_bridge.link.link import Qos, Received, Topic
from agents.ros_bridge.messages.transforms import StampedTransform, decode_transforms, encode_transforms
from dsr.clock import WALL_CLOCK
from tests.agents.ros_bridge.samples import TYPES, image, joints, plain, tf
from tests.agents.ros_bridge.told import eventually
from tests.ros.real_node import RealNode

IMAGE, JOINTS, TF = "sensor_msgs/msg/Image", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
LOOK_UP = "tf2_msgs/action/LookupTransform"
LATCHED = Qos(transient_local=True, depth=1)
FRAMES = 60
"""Two seconds of images"""
LEASE, LATELY = 20.0, 0.1
"""s after which Fast DDS and Cyclone DDS forget whoever is silent, by default (20 and 10); s between two messages"""
BUSY = 120.0
"""s after which a test fails where leases end and all find each other again: on a busy machine that takes long"""
Start = Callable[[str], RealNode]


def content(cdr: bytes | memoryview) -> tuple[str, Any]:
    """The hash of an image's pixels, and all else of the image. Bytes between fields say nothing: they are random."""
    decoded = TYPES.decode(IMAGE, cdr)
    pixels = hashlib.sha256(decoded.data.tobytes()).hexdigest()
    decoded.data = decoded.data[:0]
    return pixels, plain(decoded)


def test_joint_states_both_ways(real_node: Start, link: DdsLink) -> None:
    node, got = real_node("arm"), []
    subscription = link.subscribe(Topic("/joint_states", JOINTS, Qos(depth=20)), got.append)
    node.advertise(topic="/joint_states", type=JOINTS)
    node.subscribe(topic="/commands", type=JOINTS, depth=20)
    publisher = link.publisher(Topic("/commands", JOINTS, Qos(depth=20)))
    eventually(lambda: node.matched(topic="/joint_states")[0] and subscription.publishers() and publisher.subscribers())
    sent = [TYPES.encode(JOINTS, joints(k / 3, -k)) for k in range(20)]
    node.publish(topic="/joint_states", cdr=[cdr.hex() for cdr in sent], count=20, hz=200.0)
    for cdr in sent:
        publisher.send(cdr)
    eventually(lambda: len(got) == 20)
    assert [bytes(message.cdr) for message in got] == sent
    assert len({message.writer for message in got}) == 1 and len(got[0].writer) == 16
    assert all(a.sent < b.sent for a, b in pairwise(got))
    found = eventually(lambda: found if len(found := node.received(topic="/commands")) == 20 else [])
    assert [plain(TYPES.decode(JOINTS, bytes.fromhex(one["cdr"]))) for one in found] == [
        plain(TYPES.decode(JOINTS, cdr)) for cdr in sent
    ]


def test_tf_and_static_tf_that_was_sent_before_come_in(real_node: Start, link: DdsLink) -> None:
    node, moving, static = real_node("state_publisher"), [], []
    node.advertise(topic="/tf_static", type=TF, transient_local=True, depth=1)
    node.publish(topic="/tf_static", cdr=[TYPES.encode(TF, tf("base", "camera")).hex()])
    node.advertise(topic="/tf", type=TF, depth=100)
    subscription = link.subscribe(Topic("/tf", TF, Qos(depth=100)), moving.append)
    link.subscribe(Topic("/tf_static", TF, Qos(transient_local=True, depth=100)), static.append)
    eventually(lambda: node.matched(topic="/tf")[0] and subscription.publishers())
    node.publish(topic="/tf", cdr=[TYPES.encode(TF, tf("link_1", "link_2")).hex()], count=100, hz=200.0)
    eventually(lambda: len(moving) == 100 and static)
    assert [one.child for one in decode_transforms(static[0].cdr)] == ["base", "camera"]
    assert {tuple(one.child for one in decode_transforms(message.cdr)) for message in moving} == {("link_1", "link_2")}


def test_rclpy_composes_our_tf_and_our_static_tf_of_before(real_node: Start, link: DdsLink) -> None:
    stamps = [1_700_000_000 * 10**9 + k * 10**7 for k in range(50)]
    turned = (0.0, 0.0, 0.6, 0.8)
    link.publisher(Topic("/tf_static", TF, LATCHED)).send(
        encode_transforms([StampedTransform(0, 0, "wrist", "camera", (0.1, 0.0, 0.0, *turned))])
    )
    node = real_node("listener")
    node.listen()
    publisher = link.publisher(Topic("/tf", TF, Qos(depth=100)))
    eventually(publisher.subscribers)
    for number, stamp in enumerate(stamps):
        sec, nanosec = divmod(stamp, 10**9)
        pose = (0.01 * number, 0.0, 0.5, *turned)
        publisher.send(encode_transforms([StampedTransform(sec, nanosec, "world", "wrist", pose)]))

    def has_all() -> bool:
        return {"wrist", "camera"} <= node.frames().keys() and _reaches(node, stamps[-1])

    eventually(has_all)
    (x, y, z), rotation = node.lookup(target="world", source="camera", stamp=stamps[20])
    # A turn of q about z takes (0.1, 0, 0) to 0.1 (1 - 2 z z, 2 w z, 0).
    assert max(abs(x - (0.2 + 0.1 * 0.28)), abs(y - 0.1 * 0.96), abs(z - 0.5)) < 1e-9
    assert max(abs(a - b) for a, b in zip(rotation, (0.0, 0.0, 0.96, 0.28), strict=True)) < 1e-9


def _reaches(node: RealNode, stamp: int) -> bool:
    try:
        node.lookup(target="world", source="wrist", stamp=stamp)
    except AssertionError:
        return False
    return True


def test_images_at_30_hz_come_in_whole(real_node: Start, link: DdsLink) -> None:
    node, got = real_node("camera"), []

    def receive(message: Received) -> None:
        got.append(content(message.cdr))

    subscription = link.subscribe(Topic("/image", IMAGE, Qos(depth=5)), receive)
    node.advertise(topic="/image", type=IMAGE)
    eventually(lambda: node.matched(topic="/image")[0] and subscription.publishers())
    sent = [TYPES.encode(IMAGE, image(number)) for number in range(3)]

    def warm_up() -> list[Any]:  # whether a sample that comes before the first heartbeat is old is up to the reader
        node.publish(topic="/image", cdr=[TYPES.encode(IMAGE, image(9)).hex()])
        return got

    (early, *_) = eventually(warm_up)
    node.publish(topic="/image", cdr=[cdr.hex() for cdr in sent], count=FRAMES, hz=30.0)
    arrived = eventually(lambda: found if len(found := [one for one in got if one != early]) == FRAMES else [])
    assert arrived == [content(cdr) for cdr in sent] * (FRAMES // 3)


def test_the_first_image_comes_in_at_best_effort_as_the_bridge_asks_for_it(real_node: Start, link: DdsLink) -> None:
    node, got = real_node("camera"), []
    node.advertise(topic="/image", type=IMAGE)
    subscription = link.subscribe(Topic("/image", IMAGE, SENSOR), got.append)
    eventually(lambda: node.matched(topic="/image")[0] and subscription.publishers())
    sent = TYPES.encode(IMAGE, image(0))
    node.publish(topic="/image", cdr=[sent.hex()])
    eventually(lambda: got)
    assert [content(message.cdr) for message in got] == [content(sent)]


def test_images_at_30_hz_go_out_whole(real_node: Start, link: DdsLink) -> None:
    node = real_node("viewer")
    node.subscribe(topic="/image", type=IMAGE, depth=FRAMES)
    publisher = link.publisher(Topic("/image", IMAGE, Qos(depth=5)))
    eventually(publisher.subscribers)
    sent = [TYPES.encode(IMAGE, image(number)) for number in range(FRAMES)]
    for number, cdr in enumerate(sent, 1):
        publisher.send(cdr)
        eventually(lambda number=number: len(node.received(topic="/image")) >= number, 5.0)
    found = [(one["sha256"], content(bytes.fromhex(one["cdr"]))[1]) for one in node.received(topic="/image")]
    assert found == [content(cdr) for cdr in sent]


def test_a_subscriber_that_stands_still_holds_up_nobody(real_node: Start, link: DdsLink) -> None:
    slow, well = real_node("slow"), real_node("well")
    for node in (slow, well):
        node.subscribe(topic="/image", type=IMAGE, depth=FRAMES)
    publisher = link.publisher(Topic("/image", IMAGE, Qos(depth=5)))
    eventually(lambda: publisher.subscribers() == 2)
    publisher.send(TYPES.encode(IMAGE, image(0)))
    eventually(lambda: len(slow.received(topic="/image")) == 1 and len(well.received(topic="/image")) == 1)
    slow.stand_still()
    try:
        for number in range(1, FRAMES // 2):  # six times as many as are kept: whoever waited for it would raise
            publisher.send(TYPES.encode(IMAGE, image(number)))
            eventually(lambda number=number: len(well.received(topic="/image")) > number, 5.0)
    finally:
        slow.go_on()


def test_who_stood_still_for_longer_than_any_lease_is_found_again_or_told(real_node: Start, link: DdsLink) -> None:
    node, got = real_node("arm"), []
    node.subscribe(topic="/told", type=JOINTS, depth=FRAMES)
    node.advertise(topic="/joint_states", type=JOINTS)
    subscription = link.subscribe(Topic("/joint_states", JOINTS, SENSOR), got.append)
    publisher = link.publisher(Topic("/told", JOINTS, Qos(depth=5)))
    cdr = TYPES.encode(JOINTS, joints(0.5))

    def both_ways() -> bool:
        publisher.send(cdr)
        node.publish(topic="/joint_states", cdr=[cdr.hex()])
        return bool(got) and len(node.received(topic="/told")) > heard

    def is_told() -> bool:
        return any(one.startswith("/arm stood still for so long that DDS gave it up") for one in link.problems())

    heard = 0
    eventually(both_ways, BUSY)
    eventually(lambda: any(one.node == "/arm" for one in link.endpoints()), BUSY)  # Fast DDS tells names 3 s later
    eventually(lambda: not is_told() and link._returned is not None and link._returned._alive)
    node.stand_still()
    try:
        for _ in range(round(LEASE / LATELY)):
            publisher.send(cdr)
            WALL_CLOCK.wait(threading.Event(), LATELY)
        eventually(lambda: subscription.publishers() == 0 and publisher.subscribers() == 0, BUSY)
        eventually(lambda: not is_told() and link._returned is not None and link._returned._gone, BUSY)
    finally:
        node.go_on()
    got.clear()
    heard = len(node.received(topic="/told"))
    eventually(lambda: both_ways() or is_told(), BUSY)


def test_of_a_flood_what_is_not_taken_is_counted(real_node: Start, link: DdsLink) -> None:
    node, got, all_of_them, awake = real_node("arm"), [], [], threading.Event()

    def receive(message: Received) -> None:
        got.append(message)
        awake.wait(20.0)

    slow = link.subscribe(Topic("/joint_states", JOINTS, Qos(depth=5)), receive)
    well = link.subscribe(Topic("/joint_states", JOINTS, Qos(depth=2 * FRAMES)), all_of_them.append)
    node.advertise(topic="/joint_states", type=JOINTS, depth=FRAMES)
    eventually(lambda: node.matched(topic="/joint_states")[0] == 2 and slow.publishers() and well.publishers())
    sent = [TYPES.encode(JOINTS, joints(k / 3, -k)) for k in range(FRAMES)]
    node.publish(topic="/joint_states", cdr=[sent[0].hex()])
    eventually(lambda: got)
    node.publish(topic="/joint_states", cdr=[cdr.hex() for cdr in sent], count=FRAMES)
    eventually(lambda: len(all_of_them) == FRAMES + 1)
    awake.set()
    eventually(lambda: len(got) == 6)
    eventually(lambda: link.lost() == {"/joint_states": FRAMES - 5})
    assert [bytes(message.cdr) for message in got[1:]] == sent[-5:]


def test_each_sees_the_other_with_names_types_and_hashes(real_node: Start, link: DdsLink) -> None:
    node = real_node("arm")
    node.advertise(topic="/joint_states", type=JOINTS, reliable=False, depth=3)
    link.publisher(Topic("/tf_static", TF, LATCHED))

    def found() -> Any:
        return [one for one in link.endpoints() if one.topic.name == "/joint_states" and one.node]

    (seen,) = eventually(found)
    assert (seen.kind, seen.node, seen.topic.type, seen.mine) == ("publisher", "/arm", JOINTS, False)
    assert seen.type_hash == TYPES.hash(JOINTS) and not seen.topic.qos.reliable
    mine = eventually(lambda: [one for one in node.publishers_of(topic="/tf_static") if one[1] == "bridge"])
    assert mine == [["/dsr", "bridge", TF, mine[0][3]]] and ["bridge", "/dsr"] in node.nodes()
    hash = TYPES.hash(TF).removeprefix("RIHS01_")
    assert hash in mine[0][3].replace("\\x", "").lower() or TYPES.hash(TF) in mine[0][3]


def test_an_action_of_real_ros_is_listed_and_why_it_cannot_be_driven_over_dds_is_said(
    real_node: Start, link: DdsLink
) -> None:
    """Each vendor of DDS has requests of its own form: that of Fast DDS is in headers that Cyclone does not show."""
    real_node("looker").serve_action(name="/look_up", type=LOOK_UP)
    kinds = eventually(lambda: {one.topic.type for one in link.endpoints() if one.topic.name.startswith("/look_up/")})
    eventually(lambda: f"{LOOK_UP}_SendGoal" in {one.topic.type for one in link.endpoints() if one.kind == "service"})
    assert kinds
    client = ActionClient(link, TYPES, "/look_up", LOOK_UP)
    with pytest.raises(RosLinkError, match=r"set installed_ros to the setup\.bash"):
        client.send(TYPES.new(f"{LOOK_UP}_Goal", target_frame="a", source_frame="b"), 1.0)
    client.close()


def test_what_does_not_match_is_told(real_node: Start, link: DdsLink) -> None:
    node = real_node("driver")
    node.advertise(topic="/scan", type=JOINTS, reliable=False)
    node.advertise(topic="/state", type="std_msgs/msg/String")
    link.subscribe(Topic("/scan", JOINTS), lambda _: None)
    link.subscribe(Topic("/state", JOINTS), lambda _: None)
    told = eventually(lambda: found if (found := "\n".join(link.problems())).count("/driver has") == 2 else "")
    assert "/driver has /scan as publisher: best effort is offered, reliable is asked for" in told
    assert "/driver has /state as std_msgs/msg/String, we as sensor_msgs/msg/JointState" in told
