"""Names of frames in ROS and of nodes in the graph: each belongs to exactly one of the other.

A frame is the node of the same name, and `robot1/base_link` is the node `robot1.base_link`. A name of a node has
letters, digits, `_`, `.` and `-` only. So a frame with other characters is escaped: `/` becomes `.`, any other one
becomes `-HEX-` by its code point. A frame that looks like an escaped one is escaped, too; so nothing is lost.
"""

from __future__ import annotations

import re

from agents.ros_bridge.errors import RosMessageError
from dsr.frames.tree import WORLD

BELIEF = "belief/"
"""Prefix of the frames in which things are believed to be."""
_LONGEST = 128
"""characters of a node's name"""
_VALID = re.compile(r"[A-Za-z0-9_.\-]+")
_UNSAFE = re.compile(r"[^A-Za-z0-9_]")
_ESCAPED = re.compile(r"\.|-(?P<hex>0|[1-9a-f][0-9a-f]{0,5})-|(?P<plain>[A-Za-z0-9_]+)")


def node_of(frame: str) -> str:
    """The node of a frame; leading slashes, which tf2 does not know, are left out.

    Raises:
        RosMessageError: for an empty name, or one that no node can have because it is too long.
    """
    name = frame.lstrip("/") if len(frame) <= _LONGEST else frame
    if not name:
        raise RosMessageError("a frame without a name")
    if len(name) <= _LONGEST and not _is_plain(name):
        name = _escape(name)
    if len(name) > _LONGEST:
        raise RosMessageError(f"frame {frame[:80]!r}...: its name is too long for a node ({_LONGEST} characters)")
    return name


def frame_of(node: str) -> str:
    """The frame of a node."""
    frame = _unescape(node)
    return node if frame is None or _is_plain(frame) or frame.startswith("/") else frame


class FrameNames:
    """The names of one robot, whose tree has a root of its own name.

    Args:
        world_frame: the frame that is the graph's `world`; a frame `world` that is another one gets its name in turn.
    """

    def __init__(self, world_frame: str = WORLD) -> None:
        root = node_of(world_frame)
        self._swapped = {root: WORLD, WORLD: root}
        self._nodes: dict[str, str] = {}
        self._frames: dict[str, str] = {}

    def node(self, frame: str) -> str:
        """See `node_of`."""
        found = self._nodes.get(frame)
        if found is None:
            name = node_of(frame)
            found = _kept(self._nodes, frame, self._swapped.get(name, name))
        return found

    def frame(self, node: str) -> str:
        """See `frame_of`."""
        found = self._frames.get(node)
        if found is None:
            found = _kept(self._frames, node, frame_of(self._swapped.get(node, node)))
        return found


_MOST_KEPT = 10_000
"""Names that are remembered: more than any robot has, and few enough for memory if somebody makes them up"""


def _kept(names: dict[str, str], name: str, other: str) -> str:
    if len(names) >= _MOST_KEPT:
        names.clear()
    names[name] = other
    return other


def _is_plain(text: str) -> bool:
    """Whether frame and node have this same name: a valid one, and none that stands for an escaped frame."""
    if not _VALID.fullmatch(text):
        return False
    meant = _unescape(text)
    return meant is None or _is_plain(meant) or meant.startswith("/")


def _escape(frame: str) -> str:
    return _UNSAFE.sub(lambda found: "." if found[0] == "/" else f"-{ord(found[0]):x}-", frame)


def _unescape(name: str) -> str | None:
    """The text whose `_escape` is `name`; None if there is none, or it is `name` itself."""
    parts, end = [], 0
    for found in _ESCAPED.finditer(name):
        if found.start() != end:
            return None
        end = found.end()
        if found["plain"]:
            parts.append(found["plain"])
        elif found["hex"]:
            code = int(found["hex"], 16)
            if code > 0x10FFFF or 0xD800 <= code <= 0xDFFF:  # halves of characters, which no text in ROS has
                return None
            parts.append(chr(code))
        else:
            parts.append("/")
    text = "".join(parts)
    return text if end == len(name) and text != name and _escape(text) == name else None
