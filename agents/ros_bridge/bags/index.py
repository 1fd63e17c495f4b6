"""A bag as a recording of ours: what a bridge would have written, had it been there; made anew as it is read."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from agents.recorder.channels import SNAPSHOT
from agents.recorder.index import HISTORY, TimedRecord
from agents.ros_bridge.bags.bridging import NAME, SILENT, BagBridge
from agents.ros_bridge.bags.reader import Bag, BagMessage
from agents.ros_bridge.bags.topics import derived_config, received_topics
from agents.ros_bridge.bridge.config import RosBridgeConfig
from agents.ros_bridge.mapping.cameras import CAMERA_INFO
from agents.ros_bridge.mapping.clouds import CLOUD
from agents.ros_bridge.mapping.images import COMPRESSED, IMAGE
from agents.ros_bridge.messages.types import types_of
from dsr.config.toml import convert
from dsr.errors import ConfigError
from dsr.geometry import Mesh
from dsr.network.keys import Keys, check_name
from dsr.runtime.system import load_system

DISTRO = "jazzy"
"""Release whose definitions are used: those of the bridged messages are the same in all, and are compared"""
_STEP = 0.02
"""s between two steps of the bridge, as live"""
_IDLE = 5.0
"""s without a message after which the bridge has forgotten what it forgets, and its steps are left out"""
_SNAPSHOTS = 10.0
"""s between two snapshots that are kept to go back to"""
_MOST_SNAPSHOTS = 500
"""Of longer bags they are kept less often"""
_WORTH = 10.0
"""s of images that are not decoded from which going there anew is faster than going on"""
_SEEN_BEFORE = 2.0
"""s of images before the time asked for that are read, so that each camera has a newest one"""
_HEAVY = (IMAGE, COMPRESSED, CLOUD)
_TROUBLE = (
    "malformed", "from the future", "too large", "not written", "loops", "frames with two parents", "depth not aligned",
    "too many frames", "intrinsics of another size", "clock set back",
)  # fmt: skip
"""What a bridge counts that people should know"""


class _Place(NamedTuple):
    """The graph at a time, from which reading may begin."""

    stamp: float
    """s"""
    snapshot: bytes | None


class BagIndex:
    """Reads a bag from any time on; implements `agents.recorder.opening.RecordingSource`.

    Args:
        path: of the bag, see `Bag`.
        settings: fields of the configuration of a bridge; what is not there is derived from the bag.
        system: name or file of a system whose bridge is the one that is used.

    Raises:
        RecordingError: if it cannot be read as a bag.
        ConfigError: for a wrong setting, or a topic that is not there.
    """

    settings_of = NAME

    def __init__(self, path: Path | str, settings: Mapping[str, Any], system: str | None = None) -> None:
        self.path = Path(path)
        types = types_of(DISTRO)
        self._bag = bag = Bag(path, types)
        given = {**_of_system(system), **settings}
        derived = derived_config(bag, types)
        config = {**derived, **given, "send": SILENT}
        if config["clock"] in ("auto", "publish"):
            config["clock"] = derived["clock"]
        self._config = convert(config, RosBridgeConfig, f"settings of {NAME}")
        self._used = received_topics(bag, self._config)
        if not self._used:
            raise ConfigError(f"{path}: nothing in it is bridged; it has {', '.join(sorted(bag.topics))}")
        self._heavy = {name for name in self._used if bag.topics[name].type in _HEAVY}
        self.begin = bag.begin
        self.end = bag.end + 2.0 * _STEP
        """s, when the bridge has worked on all"""
        self.problems = bag.problems
        self.metadata = {"graph": _graph_name(self.path)}
        self.topics: Counter[str] = Counter({f"d/{NAME}-1": 1})
        self._keys = Keys(self.metadata["graph"])
        self._places = [_Place(self.begin, None)]
        self._every = max(_SNAPSHOTS, self.duration / _MOST_SNAPSHOTS)
        self._infos: dict[str, BagMessage] = {}
        self._bridges = 0
        self._counts: Counter[str] = Counter()
        self._told: dict[str, None] = {}

    @property
    def duration(self) -> float:
        """Seconds from the first message to when the bridge has worked on the last one"""
        return self.end - self.begin

    @property
    def notes(self) -> list[str]:
        """What is taken from the bag and what is not, for people."""
        config, receive = self._config, self._config.receive
        parts = ["frames"] if receive.tf and any(name in self._used for name in ("/tf", "/tf_static")) else []
        parts += [f"joints of {node!r} from {topic}" for topic, node in receive.joints.items() if topic in self._used]
        parts += [
            f"camera {node!r} from {' and '.join(filter(None, (camera.color, camera.depth)))}"
            for node, camera in receive.cameras.items()
        ]
        parts += [f"points of {node!r} from {topic}" for node, topic in receive.clouds.items()]
        parts += [f"detections from {topic}" for topic in receive.detections]
        notes = [f"taken from the bag: {', '.join(parts)}; its frame {config.world_frame!r} is the world"]
        unread = [
            f"{topic.name} ({topic.type}{': ' + topic.complaint if topic.complaint else ''})"
            for topic in self._bag.topics.values() if topic.name not in self._used
        ]  # fmt: skip
        return [*notes, f"not taken: {', '.join(sorted(unread))}"] if unread else notes

    def findings(self) -> list[str]:
        """What of the messages that were read made no sense, for people."""
        counts = [f"{count} {what}" for what in _TROUBLE if (count := self._counts[what])]
        if self._bag.malformed:
            counts.append(f"{self._bag.malformed} malformed messages of ROS 1")
        return [f"left out: {', '.join(counts)}", *self._told] if counts else []

    def read_for(self, time: float) -> Iterator[TimedRecord]:
        """Read all that is needed to know the graph at `time` (s since the first message), and everything after it."""
        return self._read(self._place_for(self.begin + time), self.begin + time - _SEEN_BEFORE)

    def skips_to(self, time: float, reached: float) -> bool:
        """Whether `read_for` is faster than going on from `reached` (s)."""
        place = self._place_for(self.begin + time)
        return place.stamp > self.begin + reached or (bool(self._heavy) and time - reached > _WORTH)

    def meshes(self) -> Iterator[Mesh]:
        """A bag has none."""
        return iter(())

    def _place_for(self, stamp: float) -> _Place:
        before = bisect_right(self._places, stamp - HISTORY, key=lambda place: place.stamp)
        return self._places[max(before - 1, 0)]

    def _read(self, place: _Place, images_from: float) -> Iterator[TimedRecord]:
        self._bridges += 1
        config = msgspec.to_builtins(self._config)
        bridge = BagBridge(self._bag, self._used, config, self._keys, place.stamp, self._bridges, place.snapshot)
        try:
            if place.snapshot is not None:
                yield TimedRecord(place.stamp - self.begin, SNAPSHOT, place.snapshot)
                for message in self._infos.values():
                    if message.time <= place.stamp:
                        bridge.play(message)
            yield from self._played(bridge, place.stamp, images_from)
        finally:
            self._note(bridge)
            bridge.close()

    def _played(self, bridge: BagBridge, begin: float, images_from: float) -> Iterator[TimedRecord]:
        steps = 0

        def step() -> Iterator[TimedRecord]:
            nonlocal steps
            now = begin + steps * _STEP
            steps += 1
            for topic, payload in bridge.tick(now):
                yield TimedRecord(min(now - self.begin, self.duration), topic, payload)
            if now - self._places[-1].stamp >= self._every:
                self._places.append(_Place(now, bridge.memory.snapshot()))

        for message in self._bag.messages(self._used, begin):
            idle_from = begin + steps * _STEP + _IDLE
            while begin + steps * _STEP < min(message.time, idle_from):
                yield from step()
            if message.time > idle_from:
                steps = math.ceil((message.time - begin) / _STEP)
            if message.topic not in self._heavy or message.time >= images_from:
                bridge.play(message)
            if self._bag.topics[message.topic].type == CAMERA_INFO:
                self._infos.setdefault(message.topic, message)
        while begin + steps * _STEP < self.end:
            yield from step()

    def _note(self, bridge: BagBridge) -> None:
        """Keep what was found; what was read twice counts once."""
        self._counts |= bridge.counts
        self._told.update(dict.fromkeys(bridge.told))


def _of_system(system: str | None) -> dict[str, Any]:
    """The configuration of the bridge in a system, without its connection; empty if there is none."""
    if system is None:
        return {}
    found = next((spec for spec in load_system(system).agents if spec.name == NAME), None)
    config = {} if found is None else dict(found.config)
    return {name: value for name, value in config.items() if name not in ("link", "node")}


def _graph_name(path: Path) -> str:
    try:
        return check_name("graph name", path.stem)
    except ConfigError:
        return "bag"
