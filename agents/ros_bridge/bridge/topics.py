"""Which topics are to be received, from their names and types: for who has no system file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.ros_bridge.mapping.apriltags import APRILTAGS
from agents.ros_bridge.mapping.cameras import CAMERA_INFO
from agents.ros_bridge.mapping.clouds import CLOUD
from agents.ros_bridge.mapping.detections import DETECTIONS
from agents.ros_bridge.mapping.images import COMPRESSED, IMAGE
from agents.ros_bridge.mapping.joints import JOINT_STATE
from agents.ros_bridge.mapping.names import node_of
from agents.ros_bridge.messages.transforms import TF_MESSAGE
from dsr.errors import ConfigError

RECEIVED = (TF_MESSAGE, JOINT_STATE, IMAGE, COMPRESSED, CAMERA_INFO, CLOUD, DETECTIONS)
"""Types of topics that can be received."""
ROBOT = "robot"
"""Node of the joints."""


def receive(topics: Mapping[str, str]) -> dict[str, Any]:
    """The part `receive` of a configuration for topics by name and type.

    Images of one camera are found by the first part of their names; `depth` in a name tells depth.

    Raises:
        ConfigError: for a type that is not bridged.
    """
    found: dict[str, Any] = {"tf": False, "joints": {}, "cameras": {}, "clouds": {}, "detections": {}}
    for name, type in sorted(topics.items()):
        if type == TF_MESSAGE:
            found["tf"] = True
        elif type == JOINT_STATE:
            found["joints"][name] = ROBOT
        elif type in (IMAGE, COMPRESSED):
            _add_image(found["cameras"], name)
        elif type == CLOUD:
            found["clouds"][topic_node(name)] = name
        elif type == DETECTIONS:
            found["detections"][name] = {}
        elif type == APRILTAGS:
            raise ConfigError(
                f"{name}: tags are read by the scene estimator, with the driver agents.ros_bridge:RosTags "
                "in a system file such as ros"
            )
        elif type != CAMERA_INFO:
            raise ConfigError(f"{name}: {type} is not bridged; {', '.join(RECEIVED)} are")
    _add_infos(found["cameras"], [name for name, type in topics.items() if type == CAMERA_INFO])
    return found


def _add_image(cameras: dict[str, dict[str, str]], name: str) -> None:
    kind = "depth" if "depth" in name.lower() else "color"
    camera = camera_node(name)
    if kind in cameras.get(camera, {}):
        camera = topic_node(name)
    cameras.setdefault(camera, {})[kind] = name


def _add_infos(cameras: dict[str, dict[str, str]], infos: list[str]) -> None:
    """A CameraInfo that was named counts for the camera that it shares most of its name with."""
    for info in sorted(infos):
        folder = info.rpartition("/")[0]
        for topics in cameras.values():
            image = topics.get("color") or topics["depth"]
            if image.startswith(f"{folder}/"):
                topics["info"] = info


def camera_node(topic: str) -> str:
    """The node of a camera by the first part of its topics. Raises `RosMessageError` for one that no node can have."""
    return node_of(topic.strip("/").partition("/")[0])


def topic_node(topic: str) -> str:
    """The node of a sensor by its whole topic. Raises `RosMessageError` for a name that no node can have."""
    return node_of(topic.strip("/").replace("/", "_"))
