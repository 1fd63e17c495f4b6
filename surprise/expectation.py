"""Finds objects that a camera should see and does not, and objects that it sees and cannot, by the edges `sees`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from dsr.believing.absence import learned_recognition, most_missed
from dsr.frames.tree import WORLD
from dsr.graph.elements import Edge
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.percepts import Percept
from dsr.vocabulary.nats import AGAIN, DECIDE, SEEN_THOUGH_HIDDEN, SURPRISING
from dsr.vocabulary.perceived import camera_nodes
from dsr.vocabulary.relations import THINGS
from surprise.beliefs import LATENCY
from surprise.config import SurpriseConfig
from surprise.evidence import KEPT


@dataclass
class _Outlook:
    """What one camera should see of one object."""

    tells: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT))
    """s, and the probability with which the object should be recognised then"""
    anew: float = -math.inf
    """s, since when what holds has held"""
    since: float | None = None
    """s, since when it would be surprising if it were missing for good; None: it would not be"""
    hidden_since: float | None = None
    """s, since when it cannot be seen"""
    covered_by: str = ""
    missed: float = 0.0
    """nats, of the frames in which it should have been seen, and was not"""
    stamps: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    """s, of its percepts"""

    def expect(self, edge: Edge | None, now: float, config: SurpriseConfig, *, tagged: bool, hidden: bool) -> None:
        """Take note of what should be seen at `now`; `hidden` says that what hides it surely does."""
        share = None if edge is None else edge.get("detectable")
        probability = 0.0 if share is None else learned_recognition().probability(share, tagged=tagged)
        self.tells.append((now, probability))
        most = most_missed(probability)
        is_due = most >= SURPRISING
        self.since = (now if self.since is None else self.since) if is_due else None
        hidden = hidden and share is not None and share <= config.nothing_seen
        self.hidden_since = (now if self.hidden_since is None else self.hidden_since) if hidden else None
        self.covered_by = "" if edge is None else edge.get("covered_by", "")
        self.missed = min(self.missed, most)

    def miss(self, stamp: float) -> None:
        """A frame of time `stamp` (s) shows other things only."""
        if stamp > self.anew:
            before = max((time for time, _ in self.tells if time < stamp), default=-math.inf)
            tells = min(probability for time, probability in self.tells if time >= before)
            self.missed = max(self.missed, min(self.missed + AGAIN * tells, most_missed(tells)))

    def start_anew(self, now: float) -> None:
        """Whatever holds has only held since `now`."""
        self.since = None if self.since is None else now
        self.hidden_since = None if self.hidden_since is None else now
        self.anew, self.missed = now, 0.0


class _Camera:
    """What is expected of one camera, and what it delivers."""

    def __init__(self) -> None:
        self.outlooks: dict[str, _Outlook] = {}
        self.frames: deque[float] = deque(maxlen=KEPT)
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
        tagged = {node.name: "marker_id" in node for node in self._memory.nodes(THINGS)}
        names = tagged.keys()
        self._cameras = {node.name: self._cameras.get(node.name) or _Camera() for node in camera_nodes(self._memory)}
        self._last_percept = {name: stamp for name, stamp in self._last_percept.items() if name in names}
        new = self._new_frames(percepts)
        elapsed = None if self._now is None else now - self._now
        self._now = now
        for name, camera in self._cameras.items():
            camera.outlooks = {key: outlook for key, outlook in camera.outlooks.items() if key in names}
            for key in names:
                edge = edges.get((name, key))
                hidden = self._is_hidden_by_an_object(edge)
                camera.outlook(key).expect(edge, now, self._config, tagged=tagged[key], hidden=hidden)
            if elapsed is None or not 0.0 < elapsed < self._config.fresh or self._moved(name, elapsed):
                camera.start_anew(now)
            for key in changed:
                camera.outlook(key).start_anew(now)
            for key, outlook in camera.outlooks.items():
                self._miss(key, outlook, new.get(name, ()))

    def missed(self, name: str) -> tuple[float, str]:
        """What the frames cost in which a camera should have seen an object, and did not, nats; and the camera.

        Of several cameras, the one that tells most.
        """
        found = ((camera.outlook(name).missed, camera_name) for camera_name, camera in self._cameras.items())
        return max(found, default=(0.0, ""))

    def impossible(self, name: str) -> tuple[float, str, str]:
        """What it costs that a camera sees an object that something hides, nats; the camera, and what hides it."""
        found = [(0.0, "", "")]
        for camera_name, camera in self._cameras.items():
            outlook = camera.outlook(name)
            if outlook.hidden_since is not None:
                start = outlook.hidden_since + LATENCY
                cost = AGAIN * sum(stamp >= start for stamp in outlook.stamps)
                found.append((min(cost, SEEN_THOUGH_HIDDEN), camera_name, outlook.covered_by))
        return max(found)

    def silence(self, camera_name: str, now: float) -> float:
        """For how long (s) a camera that should see something shows nothing, beyond the time between its frames."""
        camera = self._cameras.get(camera_name)
        since = self._due(camera)
        if camera is None or not since:
            return 0.0
        frames = list(camera.frames)
        interval = (frames[-1] - frames[0]) / (len(frames) - 1) if len(frames) > 1 else 0.0
        return max(now - max(min(since.values()), camera.newest) - interval, 0.0)

    def expected(self, camera_name: str) -> list[str]:
        """Names of the objects that a camera should see, sorted."""
        return sorted(self._due(self._cameras.get(camera_name)))

    def delivers(self, camera_name: str, now: float) -> bool:
        """Whether a camera lately showed several frames with anything in them."""
        camera = self._cameras.get(camera_name)
        stamps = [] if camera is None else [stamp for stamp in camera.frames if now - stamp <= self._config.fresh]
        return len(stamps) >= DECIDE

    def times_seen(self, name: str, since: float) -> int:
        """Percepts of an object with stamps from `since` (s) on, as far as is remembered."""
        stamps = (stamp for camera in self._cameras.values() for stamp in camera.outlook(name).stamps)
        return sum(stamp >= since for stamp in stamps)

    def _due(self, camera: _Camera | None) -> dict[str, float]:
        """Since when (s) objects should be seen, by name."""
        outlooks = {} if camera is None else camera.outlooks
        return {name: outlook.since for name, outlook in outlooks.items() if outlook.since is not None}

    def _new_frames(self, percepts: Iterable[Percept]) -> dict[str, list[float]]:
        """Take note of percepts; the stamps (s) of new frames that show anything, by camera."""
        found: dict[str, list[float]] = {}
        for percept in percepts:
            camera = self._cameras.get(percept.camera)
            self._last_percept[percept.name] = max(percept.stamp, self._last_percept.get(percept.name, -math.inf))
            if camera is None:
                continue
            camera.outlook(percept.name).stamps.append(percept.stamp)
            if percept.stamp > camera.newest:
                camera.frames.append(percept.stamp)
                found.setdefault(percept.camera, []).append(percept.stamp)
        return found

    def _miss(self, name: str, outlook: _Outlook, frames: Iterable[float]) -> None:
        """Count new frames of a camera in which an object is missing that no camera has seen since."""
        last = self._last_percept.get(name, -math.inf)
        for stamp in frames:
            if stamp > last:
                outlook.miss(stamp)
            else:
                outlook.missed = 0.0

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
