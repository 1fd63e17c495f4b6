"""How soon what a camera saw changes the belief, and how often joints and frames come: as one replica hears it."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.agent import ArmController
from agents.arm_controller.body import STILL
from benchmarks.observer import on_each_change
from dsr import Edge, Memory, Node
from dsr.frames.tree import WORLD
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.network.keys import descriptor_key
from dsr.network.transport import Subscription
from dsr.vocabulary.arms import ARM

SAME = PoseTolerance(5e-5, 5e-4)
"""m, rad up to which a belief counts as written again, unchanged (`simulation_handler.graph_io.writing`)"""
MOVED = 0.02
"""m from the belief at which a percept says that an object is elsewhere: half a cube"""
JOINTS = "joint samples"
THERE = 0.01
"""m from the percept at which the belief has followed"""


class Heard(NamedTuple):
    """A pose that came."""

    at: float
    """s, clock: when it came"""
    written: float
    """s, when its writer wrote it"""
    camera: str
    """Name of the camera; empty for a belief"""
    name: str
    pose: Pose
    """From the camera or the world to the object; its stamp is when the image was taken or the belief was stepped."""


class Delays:
    """Seconds from percepts to beliefs, from poses in the order in which they came."""

    def __init__(self) -> None:
        self.changed: list[float] = []
        """From when a percept was written to when the next change of its object's belief came"""
        self.seen: list[float] = []
        """The same, from when the image was taken"""
        self.followed: list[float] = []
        """From the first percept of an object elsewhere to when its belief was there"""
        self._waiting: dict[str, Heard] = {}
        self._believed: dict[str, Pose] = {}
        self._elsewhere: dict[str, tuple[float, Pose]] = {}

    def percept(self, heard: Heard, world_from_camera: Pose | None) -> None:
        """Take note of a percept."""
        self._waiting[heard.name] = heard
        believed = self._believed.get(heard.name)
        if world_from_camera is None or believed is None:
            return
        place = world_from_camera @ heard.pose
        if _apart(place, believed) <= MOVED:
            self._elsewhere.pop(heard.name, None)
        else:
            since = self._elsewhere.get(heard.name, (heard.written, place))[0]
            self._elsewhere[heard.name] = since, place

    def belief(self, heard: Heard, *, perceived: bool) -> None:
        """Take note of a belief; one that says the same again, or knows nothing of the percept yet, answers none.

        Nor does one of an object that is not `perceived` any more: something else has changed it.
        """
        before, self._believed[heard.name] = self._believed.get(heard.name), heard.pose
        if before is not None and SAME.covers(before, heard.pose):
            return
        percept = self._waiting.get(heard.name)
        if percept is not None and percept.written <= heard.pose.stamp:
            del self._waiting[heard.name]
        if percept is not None and percept.written <= heard.pose.stamp and perceived:
            self.changed.append(heard.at - percept.written)
            self.seen.append(heard.at - percept.pose.stamp)
        since, place = self._elsewhere.get(heard.name, (0.0, None))
        if place is not None and _apart(place, heard.pose) <= THERE:
            del self._elsewhere[heard.name]
            self.followed.append(heard.at - since)


def rate_in_motion(samples: Sequence[tuple[float, NDArray[np.float64]]], wanted: float) -> float | None:
    """Samples a second, of which each is a time (s) and positions (rad or m), while the joints moved; None if never.

    Joints that stand still are not told. So a pause counts only if they went further in it than they may unnoticed in
    as many periods of the `wanted` rate.
    """
    gaps = [
        after - before
        for (before, here), (after, there) in itertools.pairwise(samples)
        if np.abs(there - here).max() > STILL * max(1.0, (after - before) * wanted)
    ]
    return len(gaps) / sum(gaps) if gaps else None


def _apart(a: Pose, b: Pose) -> float:
    return float(np.linalg.norm(np.subtract(a.t, b.t)))


class Ear:
    """Hears percepts, beliefs, joint samples and frames."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._poses: deque[Heard] = deque()
        self._since: float | None = None
        self._counted: dict[str, list[float]] = {}
        self._joints: dict[str, list[tuple[float, NDArray[np.float64]]]] = {}
        self.delays = Delays()
        self._subscriptions: list[Subscription] = []
        on_each_change(memory, self._seen)

    def begin(self) -> None:
        """Count from now on, of all cameras that are in the memory."""
        self._since = self._memory.clock.now()
        for camera in self._memory.nodes("camera"):
            self._subscriptions.append(self._hear_frames(camera.name, camera.get("stream", camera.name)))

    def _hear_frames(self, camera: str, stream: str) -> Subscription:
        """Count what is said of frames in shared memory; the frames are left where they are."""
        what = f"frames of {camera}"
        key = descriptor_key(self._memory.keys.blob(stream))
        return self._memory.transport.subscribe(key, lambda _key, _payload: self._count(what))

    def look(self) -> None:
        """Work through what came since the last look."""
        while self._poses:
            heard = self._poses.popleft()
            if heard.camera:
                at = heard.pose.stamp
                self.delays.percept(heard, self._memory.get_transform(WORLD, heard.camera, at=at))
            else:
                node = self._memory.get_node(heard.name)
                self.delays.belief(heard, perceived=node is not None and bool(node.get("perceived")))

    def rates(self) -> dict[str, float]:
        """How many came a second, by what they are; of joints, while the arm moved."""
        found = {}
        for what, times in sorted(self._counted.items()):
            gaps = [b - a for a, b in itertools.pairwise(times)]
            if gaps:
                found[what] = len(gaps) / sum(gaps)
        for what, samples in sorted(self._joints.items()):
            if rate := rate_in_motion(samples, ArmController.rate_hz):
                found[what] = rate
        return found

    def close(self) -> None:
        """Hear nothing more."""
        for subscription in self._subscriptions:
            subscription.close()

    def _count(self, what: str) -> None:
        if self._since is not None:
            self._counted.setdefault(what, []).append(self._memory.clock.now())

    def _seen(self, element: Node | Edge, attribute: str | None) -> None:
        """Called by the thread that merges: it must not wait."""
        if isinstance(element, Node):
            if attribute == "joint_positions" and self._since is not None:
                what = f"{JOINTS} of {element.name}" if element.name != ARM else JOINTS
                positions = np.array(element["joint_positions"])
                self._joints.setdefault(what, []).append((self._memory.clock.now(), positions))
        elif self._since is not None and attribute in (None, "pose") and element.type in ("RT", "Virtual_RT"):
            camera = "" if element.type == "Virtual_RT" else element.src
            source = self._memory.get_node(camera) if camera else None
            pose, written = element.get("pose"), element.written_at("pose")
            if pose is not None and written is not None and (source is None or source.type == "camera"):
                self._poses.append(Heard(self._memory.clock.now(), written, camera, element.dst, pose))
