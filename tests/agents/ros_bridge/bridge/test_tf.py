"""Frames both ways: names, parents, writers, stamps, loops, floods, and no echo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.messages.transforms import TF_MESSAGE
from dsr import Pose
from tests.agents.ros_bridge.robot import Bridged, Robot, bridged

A, B = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)), Pose((0.0, 0.5, 0.0))


@pytest.fixture
def system() -> Iterator[Bridged]:
    with bridged({"world_frame": "map"}) as found:
        yield found


def test_frames_of_ros_are_edges_of_the_memory(system: Bridged) -> None:
    system.robot.tf(("base_link", "robot1/lidar", 0.0, B), static=True)
    for _ in range(5):
        system.robot.tf(("/map", "base_link", system.now, A))
        system.run(0.02)
    memory = system.memory
    assert memory.edge("world", "base_link", "RT")["pose"].stamp == pytest.approx(system.now, abs=0.05)
    assert memory.edge("base_link", "robot1.lidar", "RT")["pose"].stamp == 0.0
    assert memory.transform("world", "robot1.lidar").distance(A @ B) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert memory.node("base_link").type == "body"
    assert system.counts["edges written"] >= 5
    assert system.trouble == ""


def test_a_late_bridge_gets_the_static_frames() -> None:
    with bridged() as system:
        system.robot.tf(("world", "base", 0.0, A), static=True)
        system.lockstep.kill("ros_bridge")
        system.ros.subscriptions[:] = []
        system.lockstep.restart("ros_bridge")
        system.run()
        assert system.memory.transform("world", "base").distance(A) == pytest.approx((0.0, 0.0))


def test_what_came_from_ros_does_not_go_back(system: Bridged) -> None:
    found = system.robot.listen_tf()
    system.robot.tf(("map", "base_link", system.now, A))
    system.run()
    assert "base_link" in system.memory
    assert found == []


def test_edges_of_the_memory_are_frames_of_ros(system: Bridged) -> None:
    found = system.robot.listen_tf()
    memory = system.memory
    memory.add_node("world", "world")
    memory.add_node("camera", "camera")
    memory.add_node("cube_1", "cube")
    memory.add_edge("world", "camera", "RT", pose=A)
    memory.add_edge("camera", "cube_1", "RT", pose=B.with_stamp(system.now))
    memory.add_edge("world", "cube_1", "Virtual_RT", pose=A.with_stamp(system.now))
    system.run()
    names = {(one.parent, one.child): one for one in found}
    assert names.keys() == {("map", "camera"), ("camera", "cube_1"), ("map", "belief/cube_1")}
    assert names["map", "camera"].sec == 0
    assert names["camera", "cube_1"].sec + 1e-9 * names["camera", "cube_1"].nanosec == pytest.approx(system.now - 0.05)
    np.testing.assert_allclose(names["map", "belief/cube_1"].pose, (*A.t, *A.q))
    found.clear()
    system.run()
    assert found == [], "each sample is sent once"


def test_a_late_listener_gets_the_static_edges(system: Bridged) -> None:
    memory = system.memory
    for name in ("world", "arm", "camera"):
        memory.add_node(name, "world" if name == "world" else "body")
    memory.add_edge("world", "arm", "RT", pose=A)
    system.run()
    memory.add_edge("arm", "camera", "RT", pose=B)
    system.run()
    found = system.robot.listen_tf()
    assert {one.child for one in found} == {"arm", "camera"}


def test_a_late_listener_gets_no_static_edge_that_is_gone_or_moves_now(system: Bridged) -> None:
    memory = system.memory
    for name in ("world", "arm", "camera", "table"):
        memory.add_node(name, "world" if name == "world" else "body")
    for name in ("arm", "camera", "table"):
        memory.add_edge("world", name, "RT", pose=A)
    system.run()
    memory.remove_edge("world", "arm", "RT")
    memory.update_edge("world", "camera", "RT", pose=B.with_stamp(system.now))
    system.run()
    assert [one.child for one in system.robot.listen_tf()] == ["table"]
    memory.remove_edge("world", "table", "RT")
    system.run()
    assert system.robot.listen_tf() == []


def test_what_we_publish_is_not_taken_back_through_another_node(system: Bridged) -> None:
    """Somebody republishes our frames: as they are, and then below another parent."""
    memory = system.memory
    memory.add_node("world", "world")
    memory.add_node("cube_1", "cube")
    memory.add_edge("world", "cube_1", "RT", pose=A.with_stamp(system.now))
    memory.add_edge("world", "cube_1", "Virtual_RT", pose=A.with_stamp(system.now))
    system.run()
    system.robot.tf(("map", "cube_1", system.now, B), ("map", "belief/cube_1", system.now, B))
    system.run()
    assert system.counts["own frames passed on"] == 2
    assert system.trouble == ""
    system.robot.tf(("odom", "cube_1", system.now, B))
    system.run()
    assert "'cube_1' hangs from 'world'" in system.trouble and "'odom'" in system.trouble
    assert [edge.src for edge in memory.edges("RT", dst="cube_1")] == ["world"]
    assert memory.edge("world", "cube_1", "RT")["pose"].distance(A) == pytest.approx((0.0, 0.0))
    assert "belief.cube_1" not in memory and "odom" not in memory


def test_a_frame_below_a_belief_is_told_and_makes_no_second_thing(system: Bridged) -> None:
    """A grasp that a node of ROS plans, relative to where the memory believes the cup to be."""
    memory = system.memory
    memory.add_node("world", "world")
    memory.add_node("cup", "cup")
    memory.add_edge("world", "cup", "Virtual_RT", pose=A.with_stamp(system.now))
    system.run()
    system.robot.tf(("belief/cup", "grasp", system.now, B))
    system.run()
    assert "'grasp' hangs from 'belief/cup' in ROS" in system.trouble
    assert "grasp" not in memory and "belief.cup" not in memory


def test_a_frame_that_the_memory_knows_is_not_taken_over() -> None:
    with bridged({"send": {"tf": False}}) as system:
        memory = system.memory
        memory.add_node("world", "world")
        memory.add_node("base", "body")
        memory.add_edge("world", "base", "RT", pose=A)
        system.run()
        system.robot.tf(("odom", "base", system.now, B))
        system.run()
        assert "frame 'base' hangs from 'world' in the memory, and from 'odom' in ROS" in system.trouble
        system.robot.tf(("world", "base", system.now, B))
        system.run(1.5)
        assert "as well" in system.trouble
        assert memory.edge("world", "base", "RT")["pose"].distance(A) == pytest.approx((0.0, 0.0))


def test_two_publishers_of_one_frame_are_told(system: Bridged) -> None:
    other = Robot(system.ros, "/other")
    for _ in range(3):
        system.robot.tf(("map", "base", system.now, A))
        other.tf(("map", "base", system.now + 0.001, B))
        system.run()
    assert system.counts["frames with two writers"] >= 3
    assert "two publishers write frame 'base'" in system.trouble


def test_of_two_parents_the_first_one_holds_while_its_publisher_is_heard(system: Bridged) -> None:
    other = Robot(system.ros, "/other")
    for _ in range(3):
        system.robot.tf(("map", "base", system.now, A))
        other.tf(("odom", "base", system.now, B))
        system.run()
    assert system.memory.edges("RT", dst="base")[0].src == "world"
    assert "'world' and below 'odom'" in system.trouble
    system.run(1.5)
    other.tf(("odom", "base", system.now, B))
    system.run()
    assert [edge.src for edge in system.memory.edges("RT", dst="base")] == ["odom"]


def test_a_frame_may_change_its_parent(system: Bridged) -> None:
    system.robot.tf(("map", "tool", system.now, A))
    system.run()
    system.robot.tf(("hand", "tool", system.now, B))
    system.run()
    assert [edge.src for edge in system.memory.edges("RT", dst="tool")] == ["hand"]
    assert system.counts["frames that changed their parent"] == 1


def test_a_loop_is_told_and_not_written(system: Bridged) -> None:
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "d")):
        system.robot.tf((parent, child, system.now, A))
        system.run()
    assert system.counts["loops"] >= 2
    assert "loop" in system.trouble
    assert not system.memory.edges("RT", dst="a") and not system.memory.edges("RT", dst="d")
    assert system.memory.edges("RT", dst="c")


def test_a_static_frame_that_was_refused_is_written_once_it_can_be(system: Bridged) -> None:
    memory = system.memory
    for name, type in (("world", "world"), ("lidar", "body")):
        memory.add_node(name, type)
    memory.add_edge("world", "lidar", "RT", pose=A)
    system.robot.tf(("base", "lidar", 0.0, B), static=True)
    system.run(0.5)
    assert memory.get_edge("base", "lidar", "RT") is None
    memory.remove_edge("world", "lidar", "RT")
    system.run(2.5)
    assert memory.edge("base", "lidar", "RT").pose.distance(B) == pytest.approx((0.0, 0.0))


def test_of_many_frames_of_one_message_an_edge_that_somebody_removed_comes_back(system: Bridged) -> None:
    names = [f"link_{number}" for number in range(12)]
    for number in range(4):
        system.robot.tf(*(("base", name, system.now, Pose((float(number), 0.0, 0.0))) for name in names))
        system.run(0.04)
        if number == 1:
            system.memory.remove_edge("base", names[5], "RT")
    memory = system.memory
    assert [memory.edge("base", name, "RT").pose.t[0] for name in names] == [3.0] * 12


def test_stamps_from_the_future_are_dropped_and_told(system: Bridged) -> None:
    system.robot.tf(("map", "base", system.now + 3.0, A))
    system.run()
    assert "base" not in system.memory
    assert "stamped 3.0 s ahead" in system.trouble
    with bridged({"restamp": True}) as other:
        other.robot.tf(("world", "base", other.now + 3.0, A))
        other.run()
        assert other.memory.edge("world", "base", "RT")["pose"].stamp <= other.now


def test_a_clock_that_was_set_back_is_told_and_followed(system: Bridged) -> None:
    system.robot.tf(("map", "base", system.now, A))
    system.run()
    system.robot.tf(("map", "base", system.now - 100.0, B))
    system.run()
    assert "set back by 100" in system.trouble
    assert system.memory.transform("world", "base").distance(B) == pytest.approx((0.0, 0.0))


def test_late_and_repeated_transforms_are_counted(system: Bridged) -> None:
    stamp = system.now
    for _ in range(3):
        system.robot.tf(("map", "base", stamp, A))
        system.robot.tf(("map", "base", stamp - 0.1, B))
    system.run()
    assert system.counts["late or repeated transforms"] == 5
    assert system.memory.transform("world", "base").distance(A) == pytest.approx((0.0, 0.0))


def test_of_a_fast_frame_the_newest_transforms_are_written_at_the_rate(system: Bridged) -> None:
    watch = system.memory.watch(edge_type="RT", existing=False)
    written = 0
    for i in range(1000):
        system.robot.tf(("map", "base", system.now, Pose((float(i), 0.0, 0.0))))
        system.run(0.001)
        written += sum(change.name == "base" for change in watch.poll())
    system.run(0.05)
    assert 40 <= written <= 60
    assert system.memory.transform("world", "base").t[0] == 999.0


def test_a_flood_costs_bounded_memory_and_the_newest_wins(system: Bridged) -> None:
    for i in range(10_000):
        system.robot.tf(("map", "base", system.now + 1e-5 * i, Pose((float(i), 0.0, 0.0))))
    system.run()
    assert system.counts["passed over on /tf"] == 8000
    assert system.memory.transform("world", "base").t[0] == 9999.0


def test_invented_frames_do_not_fill_the_graph(system: Bridged) -> None:
    for begin in range(0, 5000, 500):
        system.robot.tf(*[("map", f"frame_{i}", system.now, A) for i in range(begin, begin + 500)])
        system.run(0.02)
    assert len(system.memory.nodes("body")) <= 4000
    assert system.counts["too many frames"] == 1000


@settings(max_examples=40)
@given(st.lists(st.binary(max_size=200), max_size=5))
def test_malformed_messages_are_counted_and_the_next_one_counts(messages: list[bytes]) -> None:
    with bridged() as system:
        for cdr in messages:
            system.robot.tf_cdr(b"\0\x01\0\0" + cdr)
        system.robot.tf(("world", "base", system.now, A))
        system.run()
        assert "base" in system.memory


def test_numbers_that_are_no_transform_are_counted(system: Bridged) -> None:
    nan = Pose.unchecked((float("nan"), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    zero = Pose.unchecked((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    system.robot.tf(("map", "a", system.now, nan), ("map", "b", system.now, zero), ("", "c", system.now, A))
    system.robot.tf(("map", "good", system.now, A))
    system.run()
    assert system.counts["malformed"] == 3
    assert "good" in system.memory and "a" not in system.memory


def test_a_tree_that_hangs_from_nothing_is_told_and_a_root_hangs_it_into_the_world() -> None:
    with bridged() as system:
        system.robot.tf(("odom", "base", system.now, A))
        system.run(2.2)
        assert "frame 'odom' hangs from nothing: set world_frame = 'odom'" in system.trouble
    with bridged({"roots": {"odom": {"translation": [0.0, 0.0, 1.0]}}}) as system:
        found = system.robot.listen_tf()
        system.robot.tf(("odom", "base", system.now, A))
        system.run(2.2)
        assert system.memory.transform("world", "base").distance(Pose((0.0, 0.0, 1.0)) @ A) == pytest.approx((0.0, 0.0))
        assert [(one.parent, one.child) for one in found] == [("world", "odom")], "ROS does not know where its root is"
        assert system.trouble == ""


def test_the_world_may_be_in_the_middle_of_the_tree() -> None:
    """`odom` is the memory's world, and a robot that knows its map hangs `odom` from `map`."""
    with bridged({"world_frame": "odom"}) as system:
        for _ in range(30):
            system.robot.tf(("map", "odom", system.now, A), ("odom", "base", system.now, B))
            system.run()
        assert system.memory.transform("world", "base").distance(B) == pytest.approx((0.0, 0.0))
        assert system.memory.transform("map", "base").distance(A @ B) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert system.trouble == ""


def test_stamps_of_long_ago_are_told_and_kept(system: Bridged) -> None:
    """A bag that is played without `--clock`, or a robot whose clock is wrong."""
    system.robot.tf(("map", "base", system.now - 3600.0, A))
    system.run()
    assert "'base' is stamped 3600.0 s behind our clock" in system.trouble
    assert system.memory.edge("world", "base", "RT")["pose"].stamp == pytest.approx(system.now - 3600.0, abs=0.1)


def test_two_cameras_that_see_one_thing_give_it_one_parent_in_tf(system: Bridged) -> None:
    found = system.robot.listen_tf()
    memory = system.memory
    for name in ("world", "left", "right"):
        memory.add_node(name, "world" if name == "world" else "camera")
    memory.add_node("cube", "cube")
    for i in range(10):
        memory.add_edge("left" if i % 2 else "right", "cube", "RT", pose=A.with_stamp(system.now))
        system.run()
    assert len({one.parent for one in found if one.child == "cube"}) == 1
    parent = next(one.parent for one in found if one.child == "cube")
    other = "left" if parent == "right" else "right"
    system.run(2.0)
    memory.add_edge(other, "cube", "RT", pose=A.with_stamp(system.now))
    system.run()
    assert found[-1].parent == other


def test_own_publishers_are_not_heard(system: Bridged) -> None:
    """A link that loops our messages back: they are known by their gid."""
    memory = system.memory
    memory.add_node("world", "world")
    memory.add_node("cube", "cube")
    publisher = next(p for p in system.ros.publishers if p.topic.name == "/tf" and p.topic.type == TF_MESSAGE)
    inbox = next(s for s in system.ros.subscriptions if s.topic.name == "/tf")
    echo = system.robot.link.publisher(publisher.topic)
    echo.writer = publisher.writer
    memory.add_edge("world", "cube", "RT", pose=A.with_stamp(system.now))
    system.run()
    assert inbox.topic.qos == Qos(depth=2000), "as many wait in the link as may wait for a tick"
    echo.send(b"malformed")
    system.run()
    assert "malformed" not in system.counts and "from /tf" not in system.counts


def test_a_frame_that_the_memory_takes_over_goes_out_from_then_on(system: Bridged) -> None:
    """First ROS alone tells where it is; then an agent hangs it elsewhere, and the memory's holds."""
    found = system.robot.listen_tf()
    system.robot.tf(("map", "tool", system.now, A))
    system.run()
    system.memory.add_node("hand", "hand")
    system.memory.add_edge("hand", "tool", "RT", pose=B.with_stamp(system.now))
    for _ in range(30):
        system.robot.tf(("map", "tool", system.now, A))
        system.memory.update_edge("hand", "tool", "RT", pose=B.with_stamp(system.now))
        system.run(0.1)
    assert [edge.src for edge in system.memory.edges("RT", dst="tool")] == ["hand"]
    assert {(one.parent, one.child) for one in found} == {("hand", "tool")}
    assert "'tool'" in system.trouble
