"""Which parts of the traffic are recorded: by name, or by name and a pattern such as `images/camera_wrist`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from dsr.errors import suggest
from dsr.network.keys import Keys
from dsr.network.transport import key_matches

IMAGE = 1 << 16
"""Bytes of a blob from which on it counts as an image: readings and detections are far smaller."""
GRAPH, STREAMS, IMAGES, DATA, MESHES = "graph", "streams", "images", "data", "meshes"
PARTS = {
    GRAPH: ("d/", "durable changes of the graph, by replica; snapshots of all of it"),
    STREAMS: ("rt/", "values that change many times a second, such as poses, by replica"),
    IMAGES: ("blob/", "frames of cameras, by stream"),
    DATA: ("blob/", "other frames, such as detections, by stream"),
    MESHES: ("mesh", "meshes that nodes name"),
    "truth": ("truth", "the truth of a simulated reality"),
    "devices": ("device/", "states of arms, their commands, readings of sensors, by device"),
    "logs": ("log/", "log records, by agent"),
    "statuses": ("status/", "statuses, by agent"),
}
"""Parts of a recording: prefix of their topics, and their meaning."""
_DEVICES = ("*/state", "*/command", "*/*/poses", "*/*/hands")
"""What is recorded of the traffic with devices: an arm, sensors that tell poses or hands; images come as blobs."""

_MOST_TOLD = 20  # streams


class MessagePart(NamedTuple):
    """A message by its part, and by what its topic says beyond that."""

    part: str
    name: str
    """Of the stream, device, agent or replica; empty for parts of one topic."""


def part_of(topic: str, size: int) -> MessagePart:
    """The part of a message of `size` bytes. Raises `ValueError` for a topic of none."""
    for part, (prefix, _) in PARTS.items():
        if topic.startswith(prefix) and (part != IMAGES or size >= IMAGE):
            return MessagePart(part, topic.removeprefix(prefix))
    raise ValueError(f"topic {topic!r}: expected one of {', '.join(PARTS)}")


class RecordSelection:
    """A choice of parts.

    Args:
        only: parts that are wanted, or `PART/PATTERN` for some of one; empty for all.
        without: what is left out of these, likewise.

    Raises:
        ValueError: for a name of no part, or a choice that makes no sense.
    """

    def __init__(self, only: Iterable[str] = (), without: Iterable[str] = ()) -> None:
        self._only = {text: _parsed(text) for text in only}
        self._without = [_parsed(text) for text in without]
        self._found: Counter[str] = Counter()
        self._streams: set[str] = set()
        if self.may_include(STREAMS) and not self.may_include(GRAPH):
            raise ValueError("streams without graph: expected both or neither, for streams change nodes of the graph")
        if not any(map(self.may_include, PARTS)):
            raise ValueError("nothing is left to record")

    def may_include(self, part: str) -> bool:
        """Whether anything of a part is wanted."""
        wanted = not self._only or any(it.part == part for it in self._only.values())
        return wanted and MessagePart(part, "") not in self._without

    def includes(self, topic: str, size: int) -> bool:
        """Whether a message of `size` bytes is wanted. Raises `ValueError` for a topic of no part."""
        found = part_of(topic, size)
        if found.part in (IMAGES, DATA) and len(self._streams) < _MOST_TOLD:
            self._streams.add(found.name)
        matching = [text for text, wanted in self._only.items() if _fits(wanted, found)]
        self._found.update(matching)
        return bool(matching or not self._only) and not any(_fits(left, found) for left in self._without)

    @property
    def unheard(self) -> list[str]:
        """What was wanted by pattern and never came, each with what was heard instead."""
        missing = [text for text, wanted in self._only.items() if wanted.name and not self._found[text]]
        streams = ", ".join(sorted(self._streams)) or "none"
        return [f"nothing came of {text}; streams heard: {streams}" for text in missing]

    def keys(self, keys: Keys) -> list[str]:
        """What to subscribe to, apart from blobs."""
        patterns = {
            GRAPH: [keys.delta(), keys.of_all_parts(keys.delta())],
            STREAMS: [keys.stream(), keys.of_all_parts(keys.stream())],
            "truth": [keys.truth()],
            "devices": [keys.device(name) for name in _DEVICES],
            "logs": [keys.log()],
            "statuses": [keys.status()],
        }
        return [key for part, found in patterns.items() if self.may_include(part) for key in found]


def _parsed(text: str) -> MessagePart:
    part, _, pattern = text.partition("/")
    if part not in PARTS:
        raise ValueError(f"{text!r} is no part of a recording; {suggest(part, PARTS)}")
    return MessagePart(part, pattern)


def _fits(wanted: MessagePart, found: MessagePart) -> bool:
    return wanted.part == found.part and (not wanted.name or _matches(wanted.name, found.name))


def _matches(pattern: str, name: str) -> bool:
    """Whether a name fits: `*` is any part between slashes; replicas fit by the name of their agent too."""
    return key_matches(pattern, name) or key_matches(pattern, name.rpartition("-")[0])
