"""The bridge as a process beside nodes of rclpy: both compose the same transforms, and what goes wrong is told.

All stamps are multiples of 1/512 s, which seconds as a float and nanoseconds state exactly.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import encode_transforms
from dsr import Pose
from dsr.clock import WALL_CLOCK
from dsr.memory import Memory
from tests.agents.ros_bridge.told import eventually
from tests.ros.bridge_process import WORLD_FRAME, Bridged, bridge_process
from tests.ros.real_node import RealNode

TF = "tf2_msgs/msg/TFMessage"
STEP = 26 / 512  # s between two samples: less often than the bridge writes at most
SAMPLES = 20
BELIEVED = ("Virtual_RT", "RT")
A, B = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)), Pose((0.1, -0.2, 0.5), (0.48, 0.36, 0.48, 0.64))
Start = Callable[[str], RealNode]


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    return f"ros_{secrets.token_hex(4)}"


@pytest.fixture
def bridged(graph: str, domain: int) -> Iterator[Bridged]:
    with bridge_process(graph, domain) as found:
        yield found


def stamps() -> list[float]:
    """Some of the last second."""
    begin = math.floor(WALL_CLOCK.now() * 512) / 512 - SAMPLES * STEP
    return [begin + number * STEP for number in range(SAMPLES)]


def moving(number: int, speed: float) -> Pose:
    """A pose on a way that no interpolation between few of its samples would meet."""
    turn = 0.05 * speed * number + 0.002 * number * number
    at = (speed * math.cos(turn), math.sin(turn), 0.01 * number)
    return Pose.from_rotvec(at, (0.3 * math.sin(turn), turn, 0.1 * turn))


def publish(node: RealNode, parent: str, child: str, stamp: float, pose: Pose, topic: str = "/tf") -> None:
    node.publish(topic=topic, cdr=[encode_transforms([to_stamped(parent, child, stamp, pose)]).hex()])


def found_by_tf2(node: RealNode, target: str, source: str, stamp: float) -> Pose | None:
    """What the listener composes; None as long as it cannot."""
    try:
        position, rotation = node.lookup(target=target, source=source, stamp=round(stamp * 512) * (10**9 // 512))
    except AssertionError:
        return None
    return Pose(position, rotation, stamp)


def newest(memory: Memory, src: str, dst: str) -> float | None:
    edge = memory.get_edge(src, dst, "RT")
    return None if edge is None else edge.pose.stamp


def check_agreement(
    node: RealNode, memory: Memory, frames: list[tuple[str, str]], other: str, times: list[float]
) -> None:
    """Each frame (in ROS, and in the memory), seen from each other, at each time, to 1e-9 m and rad."""
    for ros, name in frames:
        for ros_target, target in frames:
            for time in times:
                said = found_by_tf2(node, ros_target, ros, time)
                assert said is not None, (ros_target, ros, time)
                apart = memory.transform(target, name, at=time, types=BELIEVED).distance(said)
                assert max(apart) < 1e-9, (ros_target, ros, time, apart, other)


def between(times: list[float]) -> list[float]:
    """Times at samples and between them, in steps of 1/512 s."""
    return [times[3], times[-1], *(times[number] + number / 512 for number in range(1, SAMPLES - 1, 3))]


def test_a_chain_of_a_real_robot_is_the_same_in_tf2_and_in_the_memory(
    real_node: Start, graph: str, domain: int
) -> None:
    robot, listener = real_node("robot"), real_node("listener")
    listener.listen()
    robot.advertise(topic="/tf_static", type=TF, transient_local=True)
    robot.advertise(topic="/tf", type=TF, depth=100)
    statics = [to_stamped("arm/link_2", "wrist", 0.0, A), to_stamped("wrist", "camera", 0.0, B)]
    robot.publish(topic="/tf_static", cdr=[encode_transforms(statics).hex()])
    with bridge_process(graph, domain) as bridged:  # it joins late
        memory, times = bridged.memory, stamps()
        eventually(lambda: robot.matched(topic="/tf")[0] == 2 and newest(memory, "wrist", "camera") == 0.0)
        chain = [(WORLD_FRAME, "base"), ("base", "arm/link_1"), ("arm/link_1", "arm/link_2")]
        for number, time in enumerate(times):
            one = [to_stamped(p, c, time, moving(number, 1.0 + k)) for k, (p, c) in enumerate(chain)]
            robot.publish(topic="/tf", cdr=[encode_transforms(one).hex()])
            eventually(lambda time=time: newest(memory, "arm.link_1", "arm.link_2") == time)
        eventually(lambda: found_by_tf2(listener, WORLD_FRAME, "camera", times[-1]))
        frames = [(WORLD_FRAME, "world"), ("arm/link_1", "arm.link_1"), ("camera", "camera")]
        check_agreement(listener, memory, frames, "in", between(times))
        eventually(lambda: bridged.status.last_error == "")  # until frames hang from one another, it says so


def test_a_chain_of_the_memory_is_the_same_in_tf2(real_node: Start, bridged: Bridged) -> None:
    memory, times = bridged.memory, stamps()
    memory.add_node("world", "world")
    for name, type in (("base", "body"), ("arm.link_1", "body"), ("camera", "camera"), ("cube_1", "cube")):
        memory.add_node(name, type)
    memory.add_edge("arm.link_1", "camera", "RT", pose=B)
    listener = real_node("listener")
    listener.listen()  # after the static edge was sent
    eventually(lambda: "camera" in listener.frames())
    chain = [("world", "base", "RT"), ("base", "arm.link_1", "RT"), ("world", "cube_1", "Virtual_RT")]
    for number, time in enumerate(times):
        with memory.batch():
            for k, (src, dst, type) in enumerate(chain):
                memory.add_edge(src, dst, type, pose=moving(number, 1.0 + k).with_stamp(time))
        for ros in ("arm/link_1", "belief/cube_1"):
            eventually(lambda ros=ros, time=time: found_by_tf2(listener, WORLD_FRAME, ros, time))
    frames = [(WORLD_FRAME, "world"), ("base", "base"), ("camera", "camera"), ("belief/cube_1", "cube_1")]
    check_agreement(listener, memory, frames, "out", between(times))


def test_a_loop_and_two_parents_of_a_frame_are_told_and_the_first_holds(real_node: Start, bridged: Bridged) -> None:
    memory = bridged.memory
    first, second = real_node("first"), real_node("second")
    for node in (first, second):
        node.advertise(topic="/tf", type=TF, depth=100)
    eventually(lambda: all(node.matched(topic="/tf")[0] for node in (first, second)))

    def turns(of_second: str) -> None:
        publish(first, "a", "b", WALL_CLOCK.now(), A)
        publish(second, of_second, "b", WALL_CLOCK.now(), B)

    def is_told(what: str, of_second: str) -> bool:
        turns(of_second)
        return bridged.count(what) > 0

    eventually(lambda: [publish(first, "a", "b", WALL_CLOCK.now(), A), newest(memory, "a", "b")][1])
    eventually(lambda: is_told("frames with two parents", "other"))
    eventually(lambda: "two publishers" in bridged.status.last_error)  # the next tick tells it
    assert memory.get_edge("other", "b", "RT") is None
    eventually(lambda: is_told("frames with two writers", "a"))

    def is_moved() -> bool:  # once the first is silent, the second's word counts
        publish(second, "other", "b", WALL_CLOCK.now(), B)
        return memory.get_edge("other", "b", "RT") is not None

    eventually(is_moved)
    assert memory.get_edge("a", "b", "RT") is None

    def is_loop_told() -> bool:
        publish(second, "b", "c", WALL_CLOCK.now(), A)
        publish(second, "c", "other", WALL_CLOCK.now(), A)
        return bridged.count("loops") > 0

    eventually(is_loop_told)
    assert [len(memory.edges("RT", dst=name)) for name in ("b", "c", "other")].count(0) == 1
    assert memory.get_transform("other", "c") is not None


def test_a_clock_that_is_set_back_is_told_and_followed(real_node: Start, bridged: Bridged) -> None:
    memory, node = bridged.memory, real_node("robot")
    node.advertise(topic="/tf", type=TF, depth=100)
    eventually(lambda: node.matched(topic="/tf")[0])
    now = stamps()[0]

    def is_at(stamp: float, pose: Pose) -> bool:
        publish(node, WORLD_FRAME, "base", stamp, pose)
        return newest(memory, "world", "base") == stamp

    eventually(lambda: is_at(now, A))
    eventually(lambda: is_at(now - 100.0, B))
    assert memory.transform("world", "base").distance(B) == pytest.approx((0.0, 0.0), abs=1e-9)
    eventually(lambda: bridged.count("clock set back"))
    before = bridged.count("from the future")
    publish(node, WORLD_FRAME, "base", now + 1000.0, A)
    eventually(lambda: bridged.count("from the future") > before)
    assert newest(memory, "world", "base") == now - 100.0
