"""A camera in doubt, since all that it sees seems displaced, until it is told whether it moved, or all else did."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.calibrate import calibrate
from agents.calibrator.solve.problem import ObjectSighting
from agents.calibrator.solve.solution import CalibrationSolution
from agents.calibrator.watch.decision import Decision, alike, bumped, decide, decide_elsewhere
from agents.calibrator.watch.depths import DepthError
from agents.calibrator.watch.steps import carried_things
from agents.calibrator.watch.views import Views
from dsr.frames.tree import WORLD
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.memory import Memory

ENOUGH = 8
"""Percepts of an object that has come into view late."""


class Doubt:
    """The percepts of one camera since it came into doubt, and the way to a decision.

    Args:
        memory: what is seen.
        camera: name of its node.
        now: s; percepts from then on count.
        config: times, and the method.
        believed: world_from_object of what was believed before anything seemed displaced.
        depths: the camera's systematic errors of depth, by object.
        views: what was seen already that gave rise to it; to be gone on with.

    Raises:
        ConfigError: for a camera that nothing carries.
    """

    def __init__(
        self,
        memory: Memory,
        camera: str,
        now: float,
        config: CalibratorConfig,
        believed: Mapping[str, Pose],
        depths: Mapping[str, DepthError],
        views: Views | None = None,
    ) -> None:
        self._config = config
        self._views = views or Views(memory, camera, now, config, believed, depths, keeps_brief=False)
        self._carried = carried_things(memory)
        edge = memory.edge(self._views.parent, camera, "RT")
        self.camera = camera
        """Name of its node."""
        self.began = now
        """s"""
        self.before: Pose = edge["pose"]
        """parent_from_camera as it was."""
        self.written: Pose | None = None
        """What was written instead of it, if anything was."""
        self.solution: CalibrationSolution | None = None
        """The calibration by all views up to now."""
        self.sightings: list[ObjectSighting] = []
        """What that was made of."""
        self.decision: Decision | None = None
        """By all views up to now; None before the first."""
        self.moved_alike: Pose | None = None
        """world_from_world: how all objects moved if it was they, where that would have looked the same; else None."""
        self.is_slight = False
        """Whether nothing was surprising: the objects were displaced by so little that beliefs followed."""
        self._seen_views = 0

    @property
    def parent(self) -> str:
        """Name of the frame that carries the camera."""
        return self._views.parent

    @property
    def seen(self) -> Views:
        """Views since the doubt began, and those before that gave rise to it."""
        return self._views

    @property
    def middle(self) -> Vector3:
        """M, world: where the objects are believed to be, on average."""
        parents = self._views.parents()
        x, y, z = np.mean([(parents[one.view] @ one.believed).t for one in self.sightings], axis=0).tolist()
        return x, y, z

    def believed(self) -> dict[str, Pose]:
        """world_from_object by object: the true poses of the objects if the camera moved, and not they."""
        parents = self._views.parents()
        stayed = (one for one in self.sightings if one.name not in self._views.stopped)
        return {one.name: parents[one.view] @ one.believed for one in stayed}

    @property
    def is_open(self) -> bool:
        """Whether what was seen until now does not tell."""
        return self.decision is not None and (self.decision.moved is None or self.decision.is_ambiguous)

    @property
    def can_look_elsewhere(self) -> bool:
        """Whether something carries the camera that may move."""
        return self.parent != WORLD

    @property
    def looks_anew(self) -> bool:
        """Whether the camera sees things from elsewhere, and that has not told anything yet."""
        return len(self._views) > max(self._seen_views, 1)

    @property
    def views(self) -> int:
        """Number of places from which the camera has looked long enough."""
        return self._views.complete

    @property
    def latest(self) -> float:
        """s, stamp of the newest percept that was used."""
        return self._views.latest

    def resume(self, before: Pose, world_from_parent: Pose) -> None:
        """An earlier run adopted the present pose provisionally; `before` was parent_from_camera before that."""
        self.before, self.written = before, self.before
        self.moved_alike = alike(before, self.written, world_from_parent)
        self._seen_views = 1

    def update(self, *, last: bool = False) -> Decision | None:
        """Take in what is new; the decision if a further view is complete. `last`: no more views are to come."""
        self._views.update()
        is_new = self._views.complete > self._seen_views
        if not is_new and not (self._seen_views and (last or self._tells_more())):
            return None
        self._seen_views = self._views.complete
        sightings = self._views.sightings(complete=True)
        if not sightings:
            return None
        self.sightings = sightings
        parents = self._views.parents()
        self.solution = self._calibrated(sightings)
        if self.moved_alike is None or self._seen_views == 1:
            first = [sighting for sighting in sightings if sighting.view == 0] or sightings
            parent = parents[first[0].view]
            solution = self.solution
            if len(first) < len(sightings):
                solution = self._calibrated(first)
            self.decision = decide(first, self.before, solution, parent, self._carried)
            if self.decision.moved is None or self.decision.is_ambiguous:
                self.moved_alike = alike(self.before, solution.pose, parent)
        else:
            self.decision = decide_elsewhere(
                sightings,
                self.before,
                self.solution.pose,
                self.moved_alike,
                parents,
                last=last,
                carried=self._carried,
            )
            if self.decision.moved and self.solution.problem:
                self.decision = Decision(None, False, self.solution.problem)
        return self.decision

    def _calibrated(self, sightings: Sequence[ObjectSighting]) -> CalibrationSolution:
        """The pose by sightings. What they leave open another view will tell; of a camera on a stand, how bumps are."""
        prior = None if self.can_look_elsewhere else bumped(self.before)
        return calibrate(sightings, self.before, self._config.method, prior)

    def _tells_more(self) -> bool:
        """Whether objects have come into view, where those that were there did not tell."""
        if self.decision is None or self.decision.moved is not None:
            return False
        known = {(sighting.name, sighting.view) for sighting in self.sightings}
        return any((one.name, one.view) not in known for one in self._views.sightings(complete=True, least=ENOUGH))


def believed_now(memory: Memory) -> dict[str, Pose]:
    """world_from_object of everything that is believed somewhere."""
    edges = memory.edges("Virtual_RT", src=WORLD)
    return {edge.dst: pose for edge in edges if (pose := edge.get("pose")) is not None}


class Memories:
    """Recent beliefs of each object: later beliefs may be led astray by displaced percepts."""

    def __init__(self, span: float) -> None:
        """Kept for `span` s."""
        self._span = span
        self._known: dict[str, list[tuple[float, Pose]]] = {}

    def note(self, memory: Memory, now: float) -> None:
        """Keep what is believed at `now` (s)."""
        known = {}
        for edge in memory.edges("Virtual_RT", src=WORLD):
            pose = edge.get("pose")
            samples = self._known.get(edge.dst, [])
            if pose is not None and (not samples or samples[-1][1] is not pose):
                samples = [*samples, (now, pose)]
            recent = [index for index, (time, _) in enumerate(samples) if time >= now - self._span]
            known[edge.dst] = samples[max(recent[0] - 1, 0) :] if recent else samples[-1:]
        self._known = known

    def at(self, time: float) -> dict[str, Pose]:
        """world_from_object of everything as it was believed at `time` (s), or as early as is known."""
        found = {}
        for name, samples in self._known.items():
            until = [pose for stamp, pose in samples if stamp <= time]
            if samples and math.isfinite(time):
                found[name] = until[-1] if until else samples[0][1]
        return found
