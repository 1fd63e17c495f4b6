"""What is taken from a bag, if nobody says it: its cameras, joints, clouds and frames, and which frame is the world."""

from __future__ import annotations

import contextlib
from itertools import takewhile
from typing import Any, NamedTuple

import msgspec

from agents.packed_images import encoded_size
from agents.ros_bridge.bags.reader import Bag
from agents.ros_bridge.bridge.config import Receive, RosBridgeConfig, RosCameraTopics, Send
from agents.ros_bridge.bridge.in_tf import TF, TF_STATIC
from agents.ros_bridge.bridge.topics import RECEIVED, camera_node, receive, topic_node
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.images import COMPRESSED, IMAGE
from agents.ros_bridge.mapping.names import node_of
from agents.ros_bridge.messages.transforms import TF_MESSAGE, decode_transforms
from agents.ros_bridge.messages.types import RosTypes
from dsr.frames.tree import WORLD

CLOCK_TOPIC = "/clock"
_OURS = "/dsr/"
"""Topics of exported recordings, and of a bridge"""
_DEPTH = ("16uc1", "mono16", "32fc1")
"""Encodings of depth, in small letters"""
_LOOKED_THROUGH = 10.0
"""s of a bag in which the root of its frames is looked for: tf repeats each frame more often"""


class _View(NamedTuple):
    """What the first image of a topic tells."""

    topic: str
    is_depth: bool
    frame: str
    size: tuple[int, int] | None
    """(width, height), px"""


def derived_config(bag: Bag, types: RosTypes) -> dict[str, Any]:
    """The configuration of a bridge that takes all from a bag that it can."""
    readable = _readable(bag)
    ours = {Send().beliefs}
    others = {
        name: type for name, type in readable.items()
        if type in RECEIVED and type not in (IMAGE, COMPRESSED) and name not in ours
    }  # fmt: skip
    found = receive(others)
    found["cameras"] = cameras_of(bag, types)
    follows = CLOCK_TOPIC in readable
    return {"receive": found, "world_frame": _world_frame(bag, readable), "clock": "follow" if follows else "wall"}


def received_topics(bag: Bag, config: RosBridgeConfig) -> list[str]:
    """The topics of a bag that a bridge receives.

    Raises:
        ConfigError: if it asks for one that the bag has not, or that cannot be read.
    """
    wanted = config.receive
    named = [*wanted.clouds.values(), *wanted.detections]
    named += [topic for topic in wanted.joints if topic in bag.topics or topic not in Receive().joints]
    optional = [CLOCK_TOPIC] if config.clock == "follow" else []
    optional += [TF, TF_STATIC] if wanted.tf else []
    for camera in wanted.cameras.values():
        named += [camera.color, camera.depth, camera.depth_info]
        (named if camera.info else optional).append(camera.info_topic)
    found = [bag.topic(name).name for name in named if name]
    return [*found, *(name for name in optional if name in bag.topics and not bag.topics[name].complaint)]


def cameras_of(bag: Bag, types: RosTypes) -> dict[str, dict[str, str]]:
    """The topics of each camera, by its node.

    There is a camera for each topic of colour, with the depth of the same frame and size; and one for each other depth.
    """
    readable = _readable(bag)
    views = [
        view for name, type in sorted(readable.items())
        if type in (IMAGE, COMPRESSED) and not _is_copy(name, readable)
        and (view := _first_view(bag, types, name, type)) is not None
    ]  # fmt: skip
    depths = [view for view in views if view.is_depth]
    cameras: list[tuple[_View, dict[str, str]]] = []
    for color in (view for view in views if not view.is_depth):
        aligned = [depth for depth in depths if (depth.frame, depth.size) == (color.frame, color.size)]
        topics = {"color": color.topic}
        if aligned and color.size is not None:
            depth = max(aligned, key=lambda depth: _in_common(depth.topic, color.topic))
            depths.remove(depth)
            topics["depth"] = depth.topic
        cameras.append((color, topics))
    cameras += [(depth, {"depth": depth.topic}) for depth in depths]
    cameras.sort(key=lambda camera: (-len(camera[1]), "depth" in camera[1]))
    found: dict[str, dict[str, str]] = {}
    for view, topics in cameras:
        name = _node(view, found)
        info = msgspec.convert(topics, RosCameraTopics).info_topic
        found[name] = topics if info in readable else {**topics, **_info_beside(view.topic, readable)}
    return found


def _readable(bag: Bag) -> dict[str, str]:
    """Types of the topics that can be read."""
    return {topic.name: topic.type for topic in bag.topics.values() if not topic.complaint}


def _node(view: _View, taken: dict[str, Any]) -> str:
    """The node of a camera: of ours the one that it had, of others the first part of the topic, or all of it."""
    first = camera_node(view.topic)
    if view.topic.startswith(_OURS) and view.frame:
        with contextlib.suppress(RosMessageError):  # a name that no node can have: not one of ours
            first = node_of(view.frame)
    return first if first not in taken else topic_node(view.topic)


def _info_beside(topic: str, readable: dict[str, str]) -> dict[str, str]:
    """The CameraInfo of the nearest folder above an image, if there is one."""
    parts = topic.split("/")
    for end in range(len(parts) - 1, 1, -1):
        name = "/".join([*parts[:end], "camera_info"])
        if name in readable:
            return {"info": name}
    return {}


def _is_copy(name: str, readable: dict[str, str]) -> bool:
    """Whether the same images are there without compression."""
    base, _, way = name.rpartition("/")
    return way in ("compressed", "compressedDepth") and base in readable


def _first_view(bag: Bag, types: RosTypes, topic: str, type: str) -> _View | None:
    message = next(bag.messages([topic]), None)
    try:
        image = types.decode(type, message.cdr) if message is not None else None
    except RosMessageError:
        image = None
    if image is None:
        return _View(topic, "depth" in topic.lower(), "", None)
    frame = image.header.frame_id
    if type == IMAGE:
        return _View(topic, image.encoding.lower() in _DEPTH, frame, (image.width, image.height))
    return _View(topic, "depth" in topic.lower(), frame, encoded_size(bytes(image.data)))


def _in_common(one: str, other: str) -> int:
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))


def _world_frame(bag: Bag, readable: dict[str, str]) -> str:
    """The root of the frames; of several, the one with the most frames below it."""
    parents: dict[str, str] = {}
    tf = [name for name in (TF, TF_STATIC) if readable.get(name) == TF_MESSAGE]
    for message in bag.messages(tf) if tf else ():
        if message.time > bag.begin + _LOOKED_THROUGH:
            break
        try:
            parents.update((one.child.lstrip("/"), one.parent.lstrip("/")) for one in decode_transforms(message.cdr))
        except RosMessageError:
            continue  # counted where it is replayed
    if not parents or WORLD in parents or WORLD in parents.values():
        return WORLD
    below: dict[str, int] = {}
    for child in parents:
        root = _root(child, parents)
        below[root] = below.get(root, 0) + 1
    return max(sorted(below), key=lambda root: below[root])


def _root(frame: str, parents: dict[str, str]) -> str:
    seen = {frame}
    while frame in parents and parents[frame] not in seen:
        frame = parents[frame]
        seen.add(frame)
    return frame
