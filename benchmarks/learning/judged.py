"""How probable the truth is under the weighted worlds: minus its log density, moment by moment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.honesty.statement import DOUBT, GONE, RESOLUTION, VOLUME
from benchmarks.learning.recorded import Recorded
from dsr.math3d.transforms import Pose
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.circumstances import is_unseen
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence, SharesQuery, seen_shares
from simulation_handler.worlds.parameters import WorldParameters
from simulation_handler.worlds.weighted import WeightedWorlds

Array = NDArray[np.float64]


class RememberedShares:
    """Answers what cameras should see, and the same question again at once: whatever the parameters are."""

    def __init__(self) -> None:
        self._known: dict[tuple[float, str, Pose], float] = {}

    def __call__(self, evidence: Evidence, places: Mapping[str, Sequence[Solid]]) -> dict[str, list[float]]:
        """As `seen_shares` of one episode."""
        keys = {name: {(evidence.now, name, solid.pose): solid for solid in there} for name, there in places.items()}
        new = {name: [solid for key, solid in of.items() if key not in self._known] for name, of in keys.items()}
        for name, shares in seen_shares(evidence, {name: there for name, there in new.items() if there}).items():
            told = zip(new[name], shares, strict=True)
            self._known |= {(evidence.now, name, solid.pose): share for solid, share in told}
        return {name: [self._known[evidence.now, name, solid.pose] for solid in places[name]] for name in places}


@dataclass(frozen=True)
class Episode:
    """A recorded episode, ready to be judged many times."""

    name: str
    settle: float
    """s after the start, from which it is judged"""
    moments: Sequence[Recorded]
    shares: SharesQuery

    @cached_property
    def unseen(self) -> list[list[str]]:
        """Names of the objects that are not recognised at each moment, at the next one or at the one before."""
        absent = [
            {name for name, thing in moment.evidence.objects.items() if _is_lost(thing, moment.evidence.now)}
            for moment in self.moments
        ]
        known = [{name for name, thing in moment.evidence.objects.items() if thing.percept} for moment in self.moments]
        following, before = [*absent[1:], set()], [set(), *absent[:-1]]
        around = zip(before, absent, following, known, strict=True)
        return [sorted((earlier | now | after) & seen) for earlier, now, after, seen in around]


def log_scores(episode: Episode, parameters: WorldParameters) -> Array:
    """(n,) nats of the position of each object that is not in view, at each moment after it was first recognised."""
    worlds = WeightedWorlds(parameters, episode.shares)
    found = []
    for moment, names in zip(episode.moments, episode.unseen, strict=True):
        if names:
            worlds.update(moment.evidence, names)
        if moment.time >= episode.settle:
            found += [
                log_score_of(worlds, name, moment.truth.get(name)) for name in names if name not in moment.in_view
            ]
    return np.array(found)


def _is_lost(thing: ObjectEvidence, now: float) -> bool:
    return is_unseen(thing, now) or thing.believed is None


def log_score_of(worlds: WeightedWorlds, name: str, truth: Pose | None) -> float:
    """Minus the log density (per m^3) of the true position under the worlds of an object; None: it is gone."""
    gone, density = 0.0, 0.0
    for world in worlds.worlds(name):
        pose = world.objects[name].pose
        if pose is None:
            gone += world.weight
        elif truth is not None:
            density += world.weight * _density(pose, truth)
    said, indifferent = (gone, GONE) if truth is None else (density, (1.0 - GONE) / VOLUME)
    return -math.log((1.0 - DOUBT) * said + DOUBT * indifferent)


def _density(mean: Pose, truth: Pose) -> float:
    covariance = np.array(mean.cov).reshape(6, 6)[:3, :3] + RESOLUTION[0] ** 2 * np.eye(3)
    offset = mean.inverse().apply(truth.translation)
    distance2 = float(offset @ np.linalg.solve(covariance, offset))
    return math.exp(-0.5 * distance2) / math.sqrt((2 * math.pi) ** 3 * float(np.linalg.det(covariance)))
