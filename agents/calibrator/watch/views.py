"""Collects a camera's percepts of objects whose places are believed, view by view, for a calibration."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Container, Mapping, Set
from dataclasses import dataclass, field

import numpy as np

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.fusing import fuse
from agents.calibrator.solve.problem import ObjectSighting
from agents.calibrator.watch.depths import DepthError, without_error
from dsr.errors import ConfigError, suggest
from dsr.frames.tree import WORLD
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.percepts import Percept, PerceptReader
from dsr.vocabulary.relations import THINGS, grasped_things, present_things

_MOST_PERCEPTS = 30
"""Of one object in one view."""
_MOST_VIEWS = 64
"""Older ones are forgotten."""


@dataclass
class _Seen:
    """One object in one view."""

    believed: Pose
    """world_from_object, at first"""
    percepts: list[Pose] = field(default_factory=list)
    """Evenly spread over the time."""
    stride: int = 1
    """Of so many percepts one is kept."""
    count: int = 0
    """Percepts up to now."""
    steady: bool = True
    """Whether the belief has not changed since."""

    def add(self, percept: Pose) -> None:
        """Keep it, or one of several, so that not too many are kept."""
        if self.count % self.stride == 0:
            if len(self.percepts) == _MOST_PERCEPTS:
                self.percepts, self.stride = self.percepts[::2], 2 * self.stride
            self.percepts.append(percept)
        self.count += 1


@dataclass
class _View:
    world_from_parent: Pose
    began: float
    """Stamp of the first percept, s."""
    latest: float
    objects: dict[str, _Seen] = field(default_factory=dict)

    def steady(self, least: int) -> list[tuple[str, _Seen]]:
        """Those whose belief stood still, with `least` percepts or more, in order of their names."""
        found = sorted(self.objects.items())
        return [(name, seen) for name, seen in found if seen.steady and len(seen.percepts) >= least]


def parent_of(memory: Memory, camera: str) -> str:
    """The frame that carries a camera. Raises `ConfigError` if it is no camera, or nothing carries it."""
    node = memory.get_node(camera)
    if node is None or node.type != "camera":
        raise ConfigError(f"no camera {camera!r}; {suggest(camera, [node.name for node in memory.nodes('camera')])}")
    parents = [edge.src for edge in memory.edges("RT", dst=camera)]
    if len(parents) != 1:
        raise ConfigError(f"{camera}: expected one frame that carries it, found {', '.join(parents) or 'none'}")
    return parents[0]


def only_camera(memory: Memory) -> str:
    """The only camera, or the only one that sees objects. Raises `ConfigError` if there are several such, or none."""
    names = sorted(node.name for node in memory.nodes("camera"))
    seeing = [name for name in names if any(_is_thing(memory, edge.dst) for edge in memory.edges("RT", src=name))]
    if len(seeing) == 1:
        return seeing[0]
    if len(names) != 1:
        raise ConfigError(f"which camera? there are {', '.join(names)}" if names else "there is no camera")
    return names[0]


def _is_thing(memory: Memory, name: str) -> bool:
    node = memory.get_node(name)
    return node is not None and node.type in THINGS


class Views:
    """The views of one camera from a time on.

    Only what stands still, is believed somewhere, and is in no gripper or hand counts.

    Args:
        memory: what is seen and believed.
        camera: name of its node.
        since: s; percepts with an earlier stamp are not used.
        config: when a view is over, and what is known of errors.
        believed: world_from_object of what is to count instead of the present belief.
        depths: systematic errors of depth that are known, by object.
        keeps_brief: keep views that were over too soon, such as those from a camera on its way.

    Raises:
        ConfigError: see `parent_of`.
    """

    def __init__(
        self,
        memory: Memory,
        camera: str,
        since: float,
        config: CalibratorConfig,
        believed: Mapping[str, Pose] | None = None,
        depths: Mapping[str, DepthError] | None = None,
        *,
        keeps_brief: bool = True,
    ) -> None:
        self._keeps_brief = keeps_brief
        self._memory = memory
        self.depths = dict(depths or {})
        """Systematic errors of depth that are known, by object."""
        self._believed = dict(believed or {})
        self._since = since
        self._config = config
        self._views: deque[_View] = deque(maxlen=_MOST_VIEWS)
        self._percepts = PerceptReader(memory, timeless=False)
        self.camera = camera
        """Name of its node."""
        self.parent = parent_of(memory, camera)
        """Name of the frame that carries it."""
        self.skipped: Counter[str] = Counter()
        """What could not be used, by reason."""
        self.stopped: set[str] = set()
        """Objects that have been moved on purpose since they were seen."""

    def __len__(self) -> int:
        """Views, those included that have not lasted long enough."""
        return len(self._views)

    @property
    def latest(self) -> float:
        """Stamp of the newest percept that was used; before the first, the time from which on they count."""
        return self._views[-1].latest if self._views else self._since

    @property
    def complete(self) -> int:
        """Views that have lasted for the configured span."""
        return sum(map(self._is_complete, self._views))

    def expect(self, name: str, believed: Pose) -> None:
        """Compare what is seen of an object from now on with that (world_from_object), whatever will be believed."""
        self._believed[name] = believed
        for view in self._views:
            view.objects.pop(name, None)

    def stop(self, names: Set[str]) -> None:
        """Keep what was seen of objects that are moved now; what will be seen of them does not count."""
        self.stopped |= names

    def update(self) -> None:
        """Take in what was seen since the last call."""
        things = {node.name for node in present_things(self._memory)}
        things -= self.stopped
        held = grasped_things(self._memory)
        for percept in self._percepts.new(self._memory.clock.now(), things, (self.camera,)):
            if percept.stamp < self._since:
                continue
            belief = self._memory.get_edge(WORLD, percept.name, "Virtual_RT")
            believed = self._believed.get(percept.name, None if belief is None else belief.get("pose"))
            if percept.name in held:
                self.skipped["held by something"] += 1
            elif believed is None:
                self.skipped["believed nowhere"] += 1
            elif percept.seen.cov is None:
                self.skipped["no covariance"] += 1
            else:
                self._take(percept, believed)

    @property
    def middle(self) -> Vector3:
        """M, world: where what was seen is believed to be, on average. Raises `ConfigError` if nothing was."""
        places = [seen.believed.t for view in self._views for seen in view.objects.values()]
        if not places:
            raise ConfigError("nothing that is seen is believed to stand still")
        x, y, z = np.mean(places, axis=0).tolist()
        return x, y, z

    def parents(self) -> dict[int, Pose]:
        """world_from_parent in each view, by its number."""
        return {number: view.world_from_parent for number, view in enumerate(self._views)}

    def steady(self, least: int) -> frozenset[str]:
        """Objects whose belief stood still in some view, with `least` percepts or more there."""
        return frozenset(name for view in self._views for name, _ in view.steady(least))

    def sightings(
        self, *, complete: bool = False, least: int = 1, of: Container[str] | None = None
    ) -> list[ObjectSighting]:
        """One for each object in each view, of those whose belief stood still.

        Args:
            complete: only views that are complete.
            least: percepts from which on an object counts.
            of: only these objects; fusing the percepts of an object takes milliseconds.
        """
        config, found = self._config, []
        for number, view in enumerate(self._views):
            if complete and not self._is_complete(view):
                continue
            parent_from_world = view.world_from_parent.inverse()
            for name, seen in view.steady(least):
                if of is None or name in of:
                    known = self.depths.get(name)
                    scatter = config.depth_scatter if known is None else known.std
                    percept = fuse(seen.percepts, config.depth_bias, scatter)
                    found.append(ObjectSighting(name, number, percept, parent_from_world @ seen.believed))
        return found

    def _is_complete(self, view: _View) -> bool:
        return view.latest - view.began >= self._config.span

    def _take(self, percept: Percept, believed: Pose) -> None:
        world_from_parent = self._memory.get_transform(WORLD, self.parent, at=percept.stamp)
        if world_from_parent is None:
            self.skipped["the camera's parent is nowhere then"] += 1
            return
        view = self._view(world_from_parent, percept.stamp)
        seen = view.objects.setdefault(percept.name, _Seen(believed))
        seen.steady = seen.steady and self._config.belief_drift.covers(seen.believed, believed)
        known = self.depths.get(percept.name)
        seen.add(percept.seen if known is None else without_error(percept.seen, known.mean))

    def _view(self, world_from_parent: Pose, stamp: float) -> _View:
        """The present view, or a new one if the camera's parent is elsewhere now."""
        if self._views and self._config.new_view.covers(self._views[-1].world_from_parent, world_from_parent):
            view = self._views[-1]
        else:
            if self._views and not self._keeps_brief and not self._is_complete(self._views[-1]):
                self._views.pop()
            view = _View(world_from_parent, stamp, stamp)
            self._views.append(view)
        view.latest = max(view.latest, stamp)
        return view
