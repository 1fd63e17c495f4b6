"""Bags of one drive, in every format that there is, made by `rosbags` and `mcap`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from agents.ros_bridge.mapping.cameras import CAMERA_INFO, to_camera_info
from agents.ros_bridge.mapping.images import IMAGE, to_image
from agents.ros_bridge.mapping.joints import JOINT_STATE, to_joint_state
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, encode_transforms
from agents.ros_bridge.messages.types import types_of
from dsr import Pose
from dsr.vocabulary.intrinsics import Intrinsics

TYPES = types_of("jazzy")
BEGIN = 1_700_000_000.0
SECONDS = 4.0
DELAY = 0.005
"""s from the stamp of a message to its recording"""
SHAPE = (24, 32)
INTRINSICS = Intrinsics(40.0, 41.0, 15.5, 11.5, SHAPE[1], SHAPE[0])
MOUNT = Pose((0.1, 0.0, 0.5), (0.5, -0.5, 0.5, -0.5))
COLOR, DEPTH, INFO = "/camera/color/image_raw", "/camera/depth/image_raw", "/camera/color/camera_info"


class Message(NamedTuple):
    time: float
    """s, when it was recorded"""
    topic: str
    type: str
    cdr: bytes


def driven(since: float) -> Pose:
    """odom_from_base at a time, s since the beginning."""
    return Pose.from_rotvec((0.25 * since, 0.1, 0.0), (0.0, 0.0, 0.2 * since), BEGIN + since)


def joints(since: float) -> tuple[float, float]:
    return 0.1 * since, -0.2 * since


def color(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 256, (*SHAPE, 3), dtype=np.uint8)


def depth(number: int) -> np.ndarray:
    return np.full(SHAPE, 1000 + number, np.uint16)


def drive() -> list[Message]:
    """Frames and joints at 50 Hz, a camera at 10 Hz, and a topic of a type that is not bridged."""
    tf = encode_transforms([to_stamped("base_link", "eye", 0.0, MOUNT)])
    found = [Message(BEGIN, "/tf_static", TF_MESSAGE, tf)]
    for step in range(round(SECONDS * 50)):
        since, at = step / 50, BEGIN + step / 50 + DELAY
        pose = driven(since)
        tf = encode_transforms([to_stamped("odom", "base_link", pose.stamp, pose)])
        found.append(Message(at, "/tf", TF_MESSAGE, tf))
        state = to_joint_state(TYPES, BEGIN + since, ["a", "b"], joints(since))
        found.append(_encoded(at, "/joint_states", JOINT_STATE, state))
        if step % 5 == 0:
            number, stamp = step // 5, BEGIN + since
            found.append(_encoded(at, INFO, CAMERA_INFO, to_camera_info(TYPES, stamp, "eye", INTRINSICS)))
            found.append(_encoded(at, COLOR, IMAGE, to_image(TYPES, stamp, "eye", color(number))))
            found.append(_encoded(at, DEPTH, IMAGE, to_image(TYPES, stamp, "eye", depth(number))))
            found.append(_encoded(at, "/note", "std_msgs/msg/String", TYPES.new("std_msgs/msg/String", data="hello")))
    return found


def _encoded(time: float, topic: str, type: str, message: Any) -> Message:
    return Message(time, topic, type, TYPES.encode(type, message))


def rosbag2(
    path: Path, messages: Iterable[Message], plugin: StoragePlugin = StoragePlugin.MCAP,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:  # fmt: skip
    """A folder of rosbag2."""
    writer = Ros2Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for time, topic, type, cdr in messages:
            if topic not in connections:
                definition, digest = TYPES.definition(type), TYPES.hash(type)
                connections[topic] = writer.add_connection(topic, type, msgdef=definition, rihs01=digest)
            writer.write(connections[topic], round(time * 1e9), cdr)
    return path


def mcap(path: Path, messages: Iterable[Message], compression: CompressionType, *, chunks: bool = True) -> Path:
    """One MCAP file, as rosbag2 and others write it."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=20_000, compression=compression, use_chunking=chunks)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for time, topic, type, cdr in messages:
            if topic not in channels:
                text = TYPES.definition(type).encode() if type in TYPES else b"int32 x"
                channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(type, "ros2msg", text))
            writer.add_message(channels[topic], round(time * 1e9), cdr, round(time * 1e9))
        writer.finish()
    return path


def rosbag1(path: Path, messages: Iterable[Message], compression: Ros1Writer.CompressionFormat) -> Path:
    """A bag of ROS 1."""
    ros1, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
    for store in (ros1, ros2):
        if TF_MESSAGE not in store.types:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF_MESSAGE))
    writer = Ros1Writer(path)
    writer.set_compression(compression)
    with writer:
        connections: dict[str, Any] = {}
        for time, topic, type, cdr in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type, typestore=ros1)
            writer.write(connections[topic], round(time * 1e9), ros2.cdr_to_ros1(cdr, type))
    return path


FORMATS: dict[str, Callable[[Path, list[Message]], Path]] = {
    "mcap folder": lambda folder, messages: rosbag2(folder / "drive", messages),
    "mcap folder, chunks of zstd": lambda folder, messages: rosbag2(
        folder / "drive", messages, mode=CompressionMode.STORAGE
    ),
    "mcap file, zstd": lambda folder, messages: mcap(folder / "drive.mcap", messages, CompressionType.ZSTD),
    "mcap file, lz4": lambda folder, messages: mcap(folder / "drive.mcap", messages, CompressionType.LZ4),
    "mcap file without chunks": lambda folder, messages: mcap(
        folder / "drive.mcap", messages, CompressionType.NONE, chunks=False
    ),
    "db3 folder": lambda folder, messages: rosbag2(folder / "drive", messages, StoragePlugin.SQLITE3),
    "db3 file": lambda folder, messages: rosbag2(folder / "drive", messages, StoragePlugin.SQLITE3) / "drive.db3",
    "db3, messages of zstd": lambda folder, messages: rosbag2(
        folder / "drive", messages, StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    ),
    "db3, files of zstd": lambda folder, messages: rosbag2(
        folder / "drive", messages, StoragePlugin.SQLITE3, CompressionMode.FILE
    ),
    "ROS 1": lambda folder, messages: rosbag1(folder / "drive.bag", messages, Ros1Writer.CompressionFormat.LZ4),
    "ROS 1, bz2": lambda folder, messages: rosbag1(folder / "drive.bag", messages, Ros1Writer.CompressionFormat.BZ2),
}  # fmt: skip
"""How to make a bag in a folder, by format"""
