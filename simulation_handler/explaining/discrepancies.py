"""Detects discrepancies: objects that are seen elsewhere than believed, and objects that should be seen and are not."""

from __future__ import annotations

import math
from collections.abc import Collection, Set

from dsr.believing.absence import missed, most_missed, somewhere
from dsr.perception.scales import FRAME
from dsr.vocabulary.nats import SURPRISING
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.recognition import recognised_about
from simulation_handler.explaining.scoring import seems_displaced
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject


class Discrepancies:
    """Keeps for each object the time since when it disagrees with its percepts."""

    def __init__(self, bodies: Bodies, config: BeliefConfig) -> None:
        self._bodies = bodies
        self._config = config
        self._displaced_since: dict[str, float] = {}
        self._expected_since: dict[str, float] = {}
        self._expected_by: dict[str, dict[str, float]] = {}
        self._follow_until: dict[str, float] = {}

    @property
    def displaced(self) -> Collection[str]:
        """Objects that are seen elsewhere than believed."""
        return self._displaced_since.keys()

    @property
    def expected(self) -> Set[str]:
        """Objects that cameras should see where they are believed to be, seen or not."""
        return self._expected_by.keys()

    def update(self, now: float, visibility: VisibilityQuery | None) -> None:
        """Compare percepts with beliefs at time `now` (s)."""
        off = [item.name for item in self._bodies.objects.values() if self._is_displaced(item, now)]
        self._displaced_since = {name: self._displaced_since.get(name, now) for name in off}
        self._expected_by = self._expected(visibility, now) if visibility is not None else {}
        blind = not any(item.is_shown(now, self._late) for item in self._bodies.objects.values())
        since = {} if blind else self._expected_since  # a camera that shows nothing is covered
        self._expected_since = {name: since.get(name, now) for name in sorted(self._expected_by)}

    @property
    def _late(self) -> float:
        """Seconds by which the camera that tells soonest is late"""
        return min((item.track.late for item in self._bodies.objects.values() if item.seen_by), default=0.0)

    def missing_for(self, now: float) -> dict[str, float]:
        """Time (s) for which each object that should be seen has been missing, as far as cameras have told."""
        objects = self._bodies.objects
        return {
            name: seconds
            for name, seconds in self._unseen_for(now).items()
            if seconds > 0.0 and objects[name].estimate_at(now) is None
        }

    def missed(self, now: float) -> Set[str]:
        """Objects that should be seen where they are believed to be, and were not for surprisingly long."""
        return {name for name, seconds in self._unseen_for(now).items() if self._is_missing(name, seconds)}

    def _unseen_for(self, now: float) -> dict[str, float]:
        """Time (s) since each object that should be seen was seen or should be; negative if a camera is late."""
        tracks = {name: item.track for name, item in self._bodies.objects.items()}
        return {
            name: now - tracks[name].late - max(since, tracks[name].last_stamp)
            for name, since in self._expected_since.items()
            if name in tracks
        }

    def told_only_by(self, cameras: frozenset[str], now: float) -> frozenset[str]:
        """Objects that only some of these cameras see or, if none does, should see."""
        if not cameras:
            return frozenset()
        by = {name: item.cameras_at(now - item.track.late) for name, item in self._bodies.objects.items()}
        by = {name: seeing or frozenset(self._expected_by.get(name, ())) for name, seeing in by.items()}
        return frozenset(name for name, telling in by.items() if telling and telling <= cameras)

    def due(self, now: float, flagged: Collection[str], withheld: Collection[str]) -> tuple[str, ...]:
        """Objects that must be explained now, but for those `withheld`, sorted; empty as long as that can wait.

        It can wait until all that are displaced were flagged as surprising, or one has been off for too long, or goes
        on moving.
        """
        config, displaced, absent = self._config, self._displaced_but(withheld), self._missing_but(withheld, now)
        missing = [name for name, seconds in absent.items() if self._is_missing(name, seconds)]
        late = [name for name, since in displaced.items() if now - since >= config.unflagged_after]
        late += [name for name in missing if self._is_missing(name, absent[name] - config.unflagged_after)]
        late += [name for name in displaced if self.is_followed(name, now)]
        open_ = displaced.keys() | set(missing)
        newest = max(displaced.values(), default=-math.inf)
        if now - newest < FRAME and not late:
            return ()
        is_flagged = not open_.isdisjoint(flagged) and displaced.keys() <= set(flagged)
        return tuple(sorted(open_)) if late or is_flagged else ()

    def evidence(self, now: float, withheld: Collection[str]) -> float:
        """Time (s) for which the percepts have been as they are now, but for objects in `withheld`."""
        if displaced := self._displaced_but(withheld):
            return now - min(displaced.values()) + (self._config.confirm_frames - 1) * FRAME
        return max(self._missing_but(withheld, now).values(), default=0.0)

    def _displaced_but(self, withheld: Collection[str]) -> dict[str, float]:
        return {name: since for name, since in self._displaced_since.items() if name not in withheld}

    def _missing_but(self, withheld: Collection[str], now: float) -> dict[str, float]:
        return {name: seconds for name, seconds in self.missing_for(now).items() if name not in withheld}

    def follow(self, names: Collection[str], now: float) -> None:
        """Let objects that were just explained go on moving without a new flag."""
        self._follow_until |= dict.fromkeys(names, now + self._config.follow_for)

    def is_followed(self, name: str, now: float) -> bool:
        """Whether an object may go on moving."""
        return now <= self._follow_until.get(name, -math.inf)

    def _is_displaced(self, item: BelievedObject, now: float) -> bool:
        if item.is_led or item.name not in self._bodies.sim or item.estimate_at(now) is None:
            return False
        if item.is_told_to_rest and item.restarts == item.track.restarts:
            return False
        return seems_displaced(item, self._bodies.solid(item.name), self._config, now)

    def _is_missing(self, name: str, seconds: float) -> bool:
        """Whether it is surprising that an object is missing for so long (s)."""
        return missed(seconds / FRAME, max(self._expected_by[name].values())) >= SURPRISING

    def _expected(self, visibility: VisibilityQuery, now: float) -> dict[str, dict[str, float]]:
        """Probabilities with which cameras should recognise objects, if it would be surprising that they never do.

        Of those at rest, for what falls is not there any more when a frame comes.
        """
        bodies, in_motion = self._bodies, self._bodies.in_motion()
        solids = {name: bodies.solid(name) for name in bodies.objects if name in bodies.sim}
        expected: dict[str, dict[str, float]] = {}
        there = list(solids.values())
        for name, by_camera in zip(solids, visibility(there, there), strict=True):
            if not bodies.objects[name].is_led and name not in in_motion:
                recognised = {camera: visible.recognised for camera, visible in by_camera.items()}
                expected[name] = {camera: share for camera, share in recognised.items() if _is_due(share)}
        absent = [name for name, by in expected.items() if by and bodies.objects[name].estimate_at(now) is None]
        about = recognised_about([solids[name] for name in absent], there, visibility)
        for name, places in zip(absent, about, strict=True):
            share = somewhere([max(by_cameras) for by_cameras in zip(*places.values(), strict=True)]) if places else 0.0
            expected[name] = {camera: share for camera, there in places.items() if _is_due(min(share, max(there)))}
        return {name: by for name, by in expected.items() if by}


def _is_due(recognised: float) -> bool:
    """Whether it would be surprising if what is recognised with that probability never were."""
    return most_missed(recognised) >= SURPRISING
