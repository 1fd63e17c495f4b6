"""Finds objects that a camera should see and does not, and objects that it sees and cannot, by the edges `sees`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from dsr.frames.tree import WORLD
from dsr.graph.elements import Edge
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.percepts import Percept
from dsr.vocabulary.relations import THINGS
from surprise.config import SurpriseConfig
from surprise.evidence import Reason

_KEPT_STAMPS = 64  # stamps
_LEAST_INTERVAL = 0.01  # s, between frames of the fastest camera
_LATENCY = 0.15  # s after a change of the belief during which percepts may still be from before


@dataclass
class _Outlook:
    """What one camera should see of one object."""

    seen_since: float | None = None
    """s, since when it should be seen"""
    hidden_since: float | None = None
    """s, since when it cannot be seen"""
    covered_by: str = ""
    stamps: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_STAMPS))
    """s, of its percepts"""

    def expect(self, edge: Edge | None, now: float, config: SurpriseConfig, *, hidden: bool) -> None:
        """Take note of what should be seen at `now`; `hidden` says that what hides it surely does."""
        share = None if edge is None else edge.get("detectable")
        seen = share is not None and share >= config.all_seen
        hidden = hidden and share is not None and share <= config.nothing_seen
        self.seen_since = (now if self.seen_since is None else self.seen_since) if seen else None
        self.hidden_since = (now if self.hidden_since is None else self.hidden_since) if hidden else None
        self.covered_by = "" if edge is None else edge.get("covered_by", "")

    def start_anew(self, now: float) -> None:
        """Whatever holds has only held since `now`."""
        self.seen_since = None if self.seen_since is None else now
        self.hidden_since = None if self.hidden_since is None else now


class _Camera:
    """What is expected of one camera, and what it delivers."""

    def __init__(self) -> None:
        self.outlooks: dict[str, _Outlook] = {}
        self.frames: deque[float] = deque(maxlen=_KEPT_STAMPS)
        """s, stamps of the frames that showed anything"""
        self.pose: Pose | None = None
        """world_from_camera at the last look"""

    def outlook(self, name: str) -> _Outlook:
        return self.outlooks.setdefault(name, _Outlook())

    def start_anew(self, now: float) -> None:
        for outlook in self.outlooks.values():
            outlook.start_anew(now)

    @property
    def newest(self) -> float:
        """s, of the newest frame that showed anything."""
        return self.frames[-1] if self.frames else -math.inf


class Expectations:
    """Compares the objects that all cameras should see with their percepts."""

    def __init__(self, memory: Memory, config: SurpriseConfig) -> None:
        self._memory = memory
        self._config = config
        self._cameras: dict[str, _Camera] = {}
        self._now: float | None = None
        self._last_percept: dict[str, float] = {}  # object -> stamp, s, from any camera

    def update(self, now: float, percepts: Iterable[Percept], changed: Collection[str]) -> None:
        """Bring the expectations to time `now` (s).

        Those of the objects in `changed` begin anew, because their belief changed.
        """
        edges = {(edge.src, edge.dst): edge for edge in self._memory.edges("sees")}
        names = {node.name for node in self._memory.nodes(THINGS)}
        self._cameras = {node.name: self._cameras.get(node.name) or _Camera() for node in self._memory.nodes("camera")}
        self._last_percept = {name: stamp for name, stamp in self._last_percept.items() if name in names}
        for percept in percepts:
            self._note(percept)
        elapsed = None if self._now is None else now - self._now
        self._now = now
        for name, camera in self._cameras.items():
            camera.outlooks = {key: outlook for key, outlook in camera.outlooks.items() if key in names}
            for key in names:
                edge = edges.get((name, key))
                camera.outlook(key).expect(edge, now, self._config, hidden=self._is_hidden_by_an_object(edge))
            if elapsed is None or not 0.0 < elapsed < self._config.unexpected_after or self._moved(name, elapsed):
                camera.start_anew(now)
            for key in changed:
                camera.outlook(key).start_anew(now)

    def unseen(self, name: str) -> Reason | None:
        """Why it is surprising that no camera sees an object, if one should."""
        config, last = self._config, self._last_percept.get(name, -math.inf)
        for camera_name, camera in self._cameras.items():
            since = camera.outlook(name).seen_since
            if since is None:
                continue
            start = max(since, last)
            frames = [stamp for stamp in camera.frames if stamp > start]
            if len(frames) >= config.frames and frames[-1] - start >= config.unexpected_after:
                return Reason("unseen", f"should be seen by {camera_name}, and is not")
        return None

    def missed(self, name: str) -> int:
        """Frames since its last percept in which a camera should have seen an object; of several, the most."""
        last = self._last_percept.get(name, -math.inf)
        counts = [
            sum(stamp > max(since, last) for stamp in camera.frames)
            for camera in self._cameras.values()
            if (since := camera.outlook(name).seen_since) is not None
        ]
        return max(counts, default=0)

    def silence(self, camera_name: str, now: float) -> tuple[float, float]:
        """For how long (s) a camera that should see something shows nothing, and the time (s) between frames."""
        camera = self._cameras.get(camera_name)
        if camera is None or len(camera.frames) < self._config.frames:
            return 0.0, 1.0
        since = [outlook.seen_since for outlook in camera.outlooks.values() if outlook.seen_since is not None]
        frames = list(camera.frames)
        interval = (frames[-1] - frames[0]) / (len(frames) - 1)
        return (now - max(min(since), camera.newest) if since else 0.0), max(interval, _LEAST_INTERVAL)

    def impossible(self, name: str) -> Reason | None:
        """Why it is surprising that a camera sees an object, if it cannot."""
        config = self._config
        for camera_name, camera in self._cameras.items():
            outlook = camera.outlook(name)
            if outlook.hidden_since is None:
                continue
            start = outlook.hidden_since + _LATENCY
            stamps = [stamp for stamp in outlook.stamps if stamp >= start]
            if len(stamps) >= config.frames and stamps[-1] - outlook.hidden_since >= config.unexpected_after:
                text = f"seen by {camera_name}, though {outlook.covered_by} should hide it"
                return Reason("impossible", text)
        return None

    def silent(self, camera_name: str, now: float) -> Reason | None:
        """Why a camera is surprising that sees nothing at all, if it should see something."""
        camera = self._cameras.get(camera_name)
        if camera is None:
            return None
        expected = {name: outlook.seen_since for name, outlook in camera.outlooks.items()}
        since = {name: start for name, start in expected.items() if start is not None}
        if not since or now - max(min(since.values()), camera.newest) < self._config.silent_after:
            return None
        return Reason("silent", f"sees nothing; expected {', '.join(sorted(since))} (covered, turned away or dead)")

    def delivers(self, camera_name: str, now: float) -> bool:
        """Whether a camera lately showed several frames with anything in them."""
        camera = self._cameras.get(camera_name)
        stamps = [] if camera is None else [stamp for stamp in camera.frames if now - stamp <= self._config.fresh]
        return len(stamps) >= self._config.needed

    def times_seen(self, name: str, since: float) -> int:
        """Percepts of an object with stamps from `since` (s) on, as far as is remembered."""
        stamps = (stamp for camera in self._cameras.values() for stamp in camera.outlook(name).stamps)
        return sum(stamp >= since for stamp in stamps)

    def expects(self, camera_name: str) -> bool:
        """Whether a camera should see anything."""
        camera = self._cameras.get(camera_name)
        return camera is not None and any(outlook.seen_since is not None for outlook in camera.outlooks.values())

    def _note(self, percept: Percept) -> None:
        camera = self._cameras.get(percept.camera)
        if camera is not None:
            camera.outlook(percept.name).stamps.append(percept.stamp)
            if percept.stamp > camera.newest:
                camera.frames.append(percept.stamp)
        self._last_percept[percept.name] = max(percept.stamp, self._last_percept.get(percept.name, -math.inf))

    def _is_hidden_by_an_object(self, edge: Edge | None) -> bool:
        """Boxes around parts of the arm are larger than these, and may be seen past."""
        node = None if edge is None else self._memory.get_node(edge.get("covered_by", ""))
        return node is not None and node.type in THINGS

    def _moved(self, name: str, elapsed: float) -> bool:
        """Whether a camera has moved in the last `elapsed` s; nothing is published while it does."""
        camera = self._cameras[name]
        before = camera.pose
        camera.pose = self._memory.get_transform(WORLD, name)
        if before is None or camera.pose is None or before is camera.pose:
            return before is None
        still = PoseTolerance(self._config.camera_speed, self._config.camera_turn).scaled(elapsed)
        return not still.covers(before, camera.pose)
