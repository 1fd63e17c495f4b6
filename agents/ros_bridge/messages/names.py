"""Names of ROS 2: which are valid, and what types are called in DDS and in rmw_zenoh."""

from __future__ import annotations

import re

from agents.ros_bridge.errors import RosMessageError

_PART = r"[A-Za-z_][A-Za-z0-9_]*"
_NAME = re.compile(rf"(?:/{_PART})+")
_TYPE = re.compile(rf"({_PART})/(msg|srv|action)/({_PART})")
_DDS_TYPE = re.compile(rf"({_PART})::(msg|srv|action)::dds_::({_PART})_")


def check_name(name: str) -> str:
    """Return `name` if it is an absolute name of a topic, service or node; raises `RosMessageError` otherwise."""
    if not _NAME.fullmatch(name):
        raise RosMessageError(f"{name!r} is no absolute name of ROS 2, such as '/arm/joint_states'")
    return name


def dds_type(type: str) -> str:
    """What a type is called in DDS: `tf2_msgs::msg::dds_::TFMessage_` for `tf2_msgs/msg/TFMessage`."""
    if not (match := _TYPE.fullmatch(type)):
        raise RosMessageError(f"{type!r} is no name of a type, such as 'sensor_msgs/msg/Image'")
    return f"{match[1]}::{match[2]}::dds_::{match[3]}_"


def ros_type(name: str) -> str:
    """What a type of this DDS name is called in ROS; `name` itself if it is no type of ROS."""
    match = _DDS_TYPE.fullmatch(name)
    return f"{match[1]}/{match[2]}/{match[3]}" if match else name
