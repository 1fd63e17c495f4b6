"""Types and their encoding, against bytes and hashes of real ROS (`golden.json`) and against the public definitions."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.messages.names import check_name, dds_type, ros_type
from agents.ros_bridge.messages.types import DISTROS, NO_HASH, types_of
from tests.agents.ros_bridge.samples import TYPES, header, image, plain, samples

GOLDEN = json.loads(Path(__file__).with_name("golden.json").read_text())
STRING = "std_msgs/msg/String"
WELL_KNOWN = {
    "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "std_msgs/msg/Header": "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "geometry_msgs/msg/TransformStamped": "RIHS01_0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
    "sensor_msgs/msg/JointState": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
}
"""Published in logs and issues of ROS"""


def test_hashes_are_those_of_real_ros() -> None:
    golden = GOLDEN["hashes"]
    assert len(golden) > 180 and golden.items() >= WELL_KNOWN.items()
    assert {name: TYPES.hash(name) for name in golden} == golden


@pytest.mark.parametrize("name", sorted(samples()))
def test_bytes_of_real_ros_are_read(name: str) -> None:
    """What lies between and behind the fields is undefined there; with zeros in its place, both are alike."""
    message, real = samples()[name], bytes.fromhex(GOLDEN["bytes"][name])
    own = TYPES.encode(name, message)
    assert plain(TYPES.decode(name, real)) == plain(message) == plain(TYPES.decode(name, own))
    assert len(real) >= len(own)
    differing = sum(a != b for a, b in zip(own, real, strict=False))
    assert all(a == 0 for a, b in zip(own, real, strict=False) if a != b) and differing < len(own) / 4


@pytest.mark.parametrize("name", sorted(samples()))
def test_the_other_byte_order_is_read(name: str) -> None:
    store, message = TYPES._store, samples()[name]
    big = bytes(store.serialize_cdr(message, name, little_endian=False))
    assert big[:2] == b"\0\0" and plain(TYPES.decode(name, big)) == plain(message)


def test_large_messages_are_encoded_as_rosbags_encodes_them() -> None:
    for name, message in [("sensor_msgs/msg/Image", image()), *samples().items()]:
        assert TYPES.encode(name, message) == bytes(TYPES._store.serialize_cdr(message, name)), name


def test_images_are_read_in_place() -> None:
    cdr = TYPES.encode("sensor_msgs/msg/Image", image())
    data = TYPES.decode("sensor_msgs/msg/Image", memoryview(cdr)).data
    assert np.shares_memory(data, np.frombuffer(cdr, np.uint8))


@pytest.mark.parametrize("distro", DISTROS)
def test_each_release_has_the_types_that_the_bridge_needs(distro: str) -> None:
    types = types_of(distro)
    for name in (
        "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/PointCloud2", "vision_msgs/msg/Detection3DArray",
        "apriltag_msgs/msg/AprilTagDetectionArray", "visualization_msgs/msg/MarkerArray", "std_srvs/srv/Trigger",
        "control_msgs/action/FollowJointTrajectory", "action_msgs/srv/CancelGoal", "rosgraph_msgs/msg/Clock",
    ):  # fmt: skip
        assert name in types and types.hash(name).startswith("RIHS01_" if distro != "humble" else NO_HASH)
    feedback = dict(types.fields("control_msgs/action/FollowJointTrajectory_Feedback"))
    assert ("index" in feedback) == (distro in ("kilted", "lyrical"))


def test_messages_are_made_with_zeros_for_what_is_not_given() -> None:
    made = TYPES.new("sensor_msgs/msg/CameraInfo", header=header(), width=640)
    assert (made.width, made.height, made.k.tolist(), made.d.tolist()) == (640, 0, [0.0] * 9, [])
    assert TYPES.new("apriltag_msgs/msg/AprilTagDetection").corners[3].x == 0.0
    with pytest.raises(RosMessageError, match=r"no field 'widht'; did you mean 'width'"):
        TYPES.new("sensor_msgs/msg/Image", widht=3)
    with pytest.raises(RosMessageError, match="position"):
        TYPES.new("sensor_msgs/msg/JointState", position=["x"])


def test_values_that_do_not_fit_are_refused() -> None:
    with pytest.raises(RosMessageError, match="no std_msgs/msg/String can be made"):
        TYPES.encode(STRING, TYPES.new(STRING, data=3))
    with pytest.raises(RosMessageError, match="no sensor_msgs/msg/CameraInfo can be made"):
        TYPES.encode("sensor_msgs/msg/CameraInfo", TYPES.new("sensor_msgs/msg/CameraInfo", k=[1.0]))
    with pytest.raises(RosMessageError, match="no sensor_msgs/msg/Image can be made"):
        TYPES.encode("sensor_msgs/msg/Image", TYPES.new("sensor_msgs/msg/Image", height=-1))


@pytest.mark.parametrize(
    ("cdr", "says"),
    [
        (b"", "no encapsulation"),
        (b"\0", "no encapsulation"),
        (b"\0\x03\0\0\x02\0\0\0a\0", "no encapsulation"),  # a list of parameters
        (b"\0\x07\0\0\x02\0\0\0a\0", "no encapsulation"),  # the second version of CDR
        (b"\0\x01\0\0", "std_msgs/msg/String"),
        (b"\0\x01\0\0\x02\0\0\0a", "std_msgs/msg/String"),
        (b"\0\x01\0\0\xff\xff\xff\xffa\0", "std_msgs/msg/String"),
        (b"\0\x01\0\0\0\0\0\0", "std_msgs/msg/String"),
        (b"\0\x01\0\0\x02\0\0\0ab", "terminator"),
        (b"\0\x01\0\0\x02\0\0\0\xff\0", "utf-8"),
    ],
)
def test_malformed_strings_are_refused(cdr: bytes, says: str) -> None:
    with pytest.raises(RosMessageError, match=says):
        TYPES.decode(STRING, cdr)


@pytest.mark.parametrize("name", ["sensor_msgs/msg/Image", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"])
def test_each_truncation_is_refused(name: str) -> None:
    cdr = TYPES.encode(name, samples()[name])
    for length in range(len(cdr)):
        with pytest.raises(RosMessageError):
            TYPES.decode(name, cdr[:length])


def test_a_claim_of_billions_costs_nothing() -> None:
    empty = TYPES.encode("tf2_msgs/msg/TFMessage", TYPES.new("tf2_msgs/msg/TFMessage"))
    for claim in (2**32 - 1, 2**31, 1000):
        with pytest.raises(RosMessageError):
            TYPES.decode("tf2_msgs/msg/TFMessage", empty[:4] + struct.pack("<I", claim) + bytes(40))


def test_definitions_are_told_as_bags_have_them() -> None:
    text = TYPES.definition("vision_msgs/msg/Detection3DArray")
    assert text.startswith("std_msgs/Header header\nvision_msgs/Detection3D[] detections\n")
    assert "\nMSG: geometry_msgs/PoseWithCovariance\n" in text
    for name in ("std_srvs/srv/Trigger_Request", "nobody/msg/Knows"):
        with pytest.raises(RosMessageError):
            TYPES.definition(name)


def test_what_rosbags_has_is_taken_from_there() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    assert set(store.fielddefs) < set(TYPES) and dict(TYPES.fields(STRING)) == dict(store.fielddefs[STRING][1])


def test_names() -> None:
    assert dds_type("tf2_msgs/msg/TFMessage") == "tf2_msgs::msg::dds_::TFMessage_"
    assert ros_type("tf2_msgs::msg::dds_::TFMessage_") == "tf2_msgs/msg/TFMessage"
    assert ros_type("my::Own") == "my::Own"
    assert check_name("/arm/joint_states") == "/arm/joint_states"
    for wrong in ("", "/", "arm", "/arm/", "//arm", "/arm/*", "/1", "/a b", "/a%b", "/**"):
        with pytest.raises(RosMessageError):
            check_name(wrong)
    for wrong in ("String", "std_msgs/String", "std_msgs/msg/*", "a/msg/b/c"):
        with pytest.raises(RosMessageError):
            dds_type(wrong)
