"""Agents of the memory that are broken or mean harm: what they write misleads nobody in ROS, nor fills the bridge."""

from __future__ import annotations

import numpy as np
import pytest

from agents.ros_bridge.mapping.stamps import to_seconds
from dsr import Frame, Pose
from dsr.vocabulary.perceived import MOST_CAMERAS
from tests.agents.ros_bridge.bridge.test_sensors import CAMERA, COLOR, IMAGE, JOINTS
from tests.agents.ros_bridge.robot import bridged

A = Pose((1.0, 2.0, 3.0))
AHEAD = 1000.0
"""s, of stamps of a time to come: tf2 would take no older transform of that frame"""


@pytest.mark.parametrize("other", ["world", "table"])
def test_a_transform_of_a_time_to_come_is_not_sent_and_hinders_no_later_one(other: str) -> None:
    with bridged() as system:
        memory, found = system.memory, system.robot.listen_tf()
        for name, type in (("world", "world"), ("table", "table"), ("cube", "cube")):
            memory.add_node(name, type)
        memory.add_edge(other, "cube", "RT", pose=A.with_stamp(system.now + AHEAD))
        system.run()
        assert found == [] and "ahead of our clock" in system.trouble
        memory.add_edge("world", "cube", "RT", pose=A.with_stamp(system.now))
        system.run()
        assert [(one.parent, one.child) for one in found] == [("world", "cube")]
        assert to_seconds(found[0]) <= system.now


def test_a_transform_that_is_written_once_by_a_clock_that_is_ahead_is_sent_when_its_time_has_come() -> None:
    """As of a table that rests: nobody writes it again."""
    with bridged() as system:
        memory, found = system.memory, system.robot.listen_tf()
        for name, type in (("world", "world"), ("table", "table"), ("cube", "cube")):
            memory.add_node(name, type)
        memory.add_edge("world", "table", "RT", pose=A.with_stamp(system.now + 0.6))
        memory.add_edge("world", "cube", "RT", pose=A.with_stamp(system.now + 2.0))
        system.run()
        assert found == []
        system.run(0.2)
        assert [one.child for one in found] == ["table"]
        memory.update_edge("world", "cube", "RT", pose=A.with_stamp(system.now + 0.1))
        system.run(3.0)
        assert [(one.child, to_seconds(one) <= system.now - 2.0) for one in found] == [("table", True), ("cube", True)]


def test_a_thing_that_a_clock_that_is_ahead_writes_all_the_time_is_in_tf() -> None:
    with bridged() as system:
        memory, found = system.memory, system.robot.listen_tf()
        for name, type in (("world", "world"), ("cube", "cube")):
            memory.add_node(name, type)
        for _ in range(40):
            memory.add_edge("world", "cube", "RT", pose=A.with_stamp(system.now + 0.6))
            system.run(0.05)
        stamps = [to_seconds(one) for one in found]
        assert len(stamps) > 10 and stamps == sorted(set(stamps)) and stamps[-1] <= system.now + 0.5


def test_what_waits_for_its_time_is_forgotten_with_its_edge() -> None:
    with bridged() as system:
        memory, found = system.memory, system.robot.listen_tf()
        for name, type in (("world", "world"), ("cube", "cube")):
            memory.add_node(name, type)
        for _ in range(3):
            memory.add_edge("world", "cube", "RT", pose=A.with_stamp(system.now + 2.0))
            system.run()
            memory.remove_edge("world", "cube", "RT")
            system.run()
        assert not system.lockstep.runner("ros_bridge").agent._tf_out._upcoming._waiting
        system.run(3.0)
        assert found == []


def test_images_of_a_clock_that_is_ahead_are_sent_when_their_time_has_come() -> None:
    with bridged() as system:
        system.memory.add_node("eye", "camera", stream="eye")
        system.robot.listen("/dsr/eye/image_raw", IMAGE)
        system.run(1.0)
        for _ in range(40):
            system.memory.put_frame("eye", Frame(system.now + 0.6, {"color": COLOR}, {}))
            system.run(0.05)
            heard = system.robot.heard["/dsr/eye/image_raw"]
            assert all(to_seconds(one.header.stamp) <= system.now + 0.5 for one in heard)
        assert len(heard) > 10


def test_an_image_of_a_time_to_come_is_not_sent() -> None:
    with bridged() as system:
        system.memory.add_node("eye", "camera", stream="eye")
        system.robot.listen("/dsr/eye/image_raw", IMAGE)
        system.run(1.0)
        for ahead in (AHEAD, 0.0):
            system.memory.put_frame("eye", Frame(system.now + ahead, {"color": COLOR}, {}))
            system.run(0.2)
        assert [to_seconds(one.header.stamp) < system.now for one in system.robot.heard["/dsr/eye/image_raw"]] == [True]
        assert "ahead of our clock" in system.trouble


def test_joints_that_somebody_stamped_for_a_time_to_come_are_of_now() -> None:
    """Their writer goes beyond that stamp with each of its own, so that they would never be sent again."""
    with bridged() as system:
        memory = system.memory
        memory.add_node("arm", "arm", joint_names="elbow", joint_positions=(0.1,))
        system.robot.listen("/dsr/joint_states", JOINTS)
        system.run()
        memory._graph.hlc.observe(int((system.now + AHEAD) * 1e6) << 10, system.now)
        memory.update_node("arm", joint_positions=(0.2,))
        system.run()
        told = system.robot.heard["/dsr/joint_states"][-1]
        assert told.position.tolist() == [0.2] and to_seconds(told.header.stamp) <= system.now


def test_a_frame_cannot_pass_for_what_is_believed() -> None:
    """In ROS `belief/cube` is where the belief has the cube, whatever nodes there are."""
    with bridged() as system:
        memory, found = system.memory, system.robot.listen_tf()
        for name, type in (("world", "world"), ("cube", "cube"), ("belief.cube", "body")):
            memory.add_node(name, type)
        memory.add_edge("world", "cube", "Virtual_RT", pose=A.with_stamp(system.now))
        memory.add_edge("world", "belief.cube", "RT", pose=Pose(stamp=system.now))
        system.run()
        assert [(one.child, one.pose[:3]) for one in found] == [("belief/cube", A.t)]
        assert "belief.cube" in system.trouble


@pytest.mark.parametrize(("real", "fake"), [("my_eye", "my.eye"), ("my.eye", "my-eye")])
def test_no_camera_sends_on_the_topic_of_another_one(real: str, fake: str) -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    with bridged() as system:
        system.robot.listen("/dsr/my_eye/image_raw", IMAGE)
        for name in (real, fake):
            system.memory.add_node(name, "camera", stream=name)
            system.run(1.0)
        for _ in range(5):
            system.memory.put_frame(fake, Frame(system.now, {"color": COLOR}, {}))
            system.memory.put_frame(real, Frame(system.now, {"color": picture}, {}))
            system.run(0.2)
        heard = system.robot.heard["/dsr/my_eye/image_raw"]
        assert heard and not any(np.asarray(one.data).any() for one in heard)
        assert fake in system.trouble


def test_a_camera_has_the_topic_of_its_name_though_another_one_came_before() -> None:
    with bridged() as system:
        system.robot.listen("/dsr/my_eye/image_raw", IMAGE)
        for name in ("my.eye", "my_eye"):
            system.memory.add_node(name, "camera", stream=name)
            system.run(1.0)
        system.memory.put_frame("my_eye", Frame(system.now, {"color": COLOR}, {}))
        system.run(0.2)
        assert len(system.robot.heard["/dsr/my_eye/image_raw"]) == 1


def test_a_camera_keeps_its_topic_against_one_of_another_agent_that_is_named_after_it() -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    with bridged() as system:
        system.robot.listen("/dsr/left_eye/image_raw", IMAGE)
        system.memory.add_node("left-eye", "camera", stream="left-eye")
        system.run(1.0)
        liar = system.lockstep._join("liar", "liar-1", None)
        liar.add_node("left_eye", "camera", stream="left_eye")
        liar.flush()
        system.run(1.0)
        for _ in range(4):
            system.memory.put_frame("left-eye", Frame(system.now, {"color": picture}, {}))
            liar.put_frame("left_eye", Frame(system.now, {"color": COLOR}, {}))
            system.run(0.5)
        heard = system.robot.heard["/dsr/left_eye/image_raw"]
        assert len(heard) == 4 and not any(np.asarray(one.data).any() for one in heard)
        told = system.lockstep.runner("ros_bridge").agent.told
        assert [text.split()[1] for text in told if "topic" in text] == ["'left_eye'", "'left-eye'"]


def test_what_came_from_ros_is_not_sent_back_by_a_camera_that_names_its_stream() -> None:
    with bridged(CAMERA) as system:
        system.memory.add_node("mirror", "camera", stream="eye")
        system.memory.add_node("broken", "camera", stream="**")
        system.run()
        assert not any(one.topic.type == IMAGE for one in system.ros.publishers)
        assert "'**' is no name" in system.trouble


def test_however_many_cameras_somebody_makes_up_topics_are_few_and_those_of_others_stay() -> None:
    with bridged() as system:
        system.memory.add_node("z_eye", "camera", stream="z_eye")
        liar = system.lockstep._join("liar", "liar-1", None)
        for number in range(2 * MOST_CAMERAS):
            liar.add_node(f"a_{number}", "camera", stream=f"a_{number}")
        liar.flush()
        system.run(0.5)
        topics = {one.topic.name for one in system.ros.publishers if one.topic.type == IMAGE}
        assert len(topics) == 2 * MOST_CAMERAS and "/dsr/z_eye/image_raw" in topics


def test_cameras_that_come_and_go_leave_nothing_in_the_bridge() -> None:
    with bridged() as system:
        system.run()
        core = system.lockstep.runner("ros_bridge").agent._core
        before = len(core._closers), len(core.own)
        for _ in range(20):
            system.memory.add_node("eye", "camera", stream="eye")
            system.run()
            system.memory.remove_node("eye")
            system.run()
        assert (len(core._closers), len(core.own)) == before
