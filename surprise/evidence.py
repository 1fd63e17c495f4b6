"""The last percepts of an object from one camera: one piece of evidence about its belief.

How sure the belief was before all of it counts: a belief that contradictions have made unsure would excuse them.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.nats import DECIDE, FALSE_FRAME, MOST_MISFIT
from surprise.config import SurpriseConfig
from surprise.deviation import Deviation, compare, compare_all
from surprise.misfit import DepthBias, Misfit, describe, disagreement, disagrees, is_surprising, misfit

KEPT = math.ceil(MOST_MISFIT / FALSE_FRAME)
"""count of percepts that are one evidence: more could not make it less probable"""


@dataclass(frozen=True)
class Reason:
    """Why an object or a camera is surprising."""

    kind: str
    text: str
    extent: float = 0.0
    """Extent of the deviation, m or rad; 0 where there is no such thing."""


@dataclass
class DeviationSighting:
    """A percept with its deviation from the belief."""

    stamp: float
    """Time of the percept, s."""
    pose: Pose
    """world_from_object"""
    eye: Vector3
    """m, of the camera in the world"""
    deviation: Deviation
    prior: Pose
    """world_from_object as believed before the evidence that the percept belongs to"""


class EvidenceTrack:
    """The last percepts of one object from one camera, against the belief."""

    def __init__(self, camera: str, config: SurpriseConfig) -> None:
        self.camera = camera
        self._config = config
        self._sightings: deque[DeviationSighting] = deque(maxlen=KEPT)
        self._offset = 0.0  # m along the viewing ray, mean of the percepts that agree
        self._learned = 0  # percepts of which that is made
        self._misfits: dict[float, Misfit] = {}
        """How badly the belief explains them, by what a false one costs; empty since something has changed"""

    @property
    def last_stamp(self) -> float:
        """s, of the newest percept."""
        return self._sightings[-1].stamp if self._sightings else -math.inf

    def span(self) -> list[DeviationSighting]:
        """The newest percepts without a pause, the oldest first."""
        start = self.start(self.last_stamp)
        return [sighting for sighting in self._sightings if sighting.stamp >= start]

    def start(self, stamp: float) -> float:
        """When the evidence begins that a percept of time `stamp` (s) belongs to, s: the first of these percepts.

        Percepts belong together that are kept, and come without a pause.
        """
        for sighting in reversed(self._sightings):
            if stamp - sighting.stamp > self._config.fresh:
                break
            stamp = sighting.stamp
        return stamp

    def add(
        self, stamp: float, pose: Pose, eye: Vector3, beliefs: Sequence[Pose], before: Callable[[float], Pose | None]
    ) -> None:
        """Take in a percept.

        Args:
            stamp: of the percept, s.
            pose: world_from_object as it is perceived.
            eye: m, of the camera in the world.
            beliefs: world_from_object as believed now and then; the one it fits best counts.
            before: gives what was believed before a time (s): how sure that was counts.
        """
        prior = self._prior(stamp, before) or beliefs[0]
        deviation, cost = self._least(compare_all(pose, eye, beliefs, self._config, prior=prior))
        self._sightings.append(DeviationSighting(stamp, pose, eye, deviation, prior))
        self._misfits.clear()
        if not is_surprising(cost):
            self._learned = min(self._learned + 1, self._config.learn_window)
            self._offset += (deviation.depth.vector[0] - self._offset) / self._learned

    def belief_jumped(self, belief: Pose) -> None:
        """The belief was changed on purpose: earlier percepts count only if they agree with the new one or the old."""
        self._learned, self._offset = 0, 0.0
        self.belief_changed(belief)
        self._misfits.clear()
        for sighting in list(self._sightings):
            sighting.prior = belief
            if disagrees(sighting.deviation, self.bias):
                self._sightings.remove(sighting)

    def belief_changed(self, belief: Pose) -> None:
        """Compare the last percepts with a newer belief as well; the one that they fit best counts."""
        for sighting in self._sightings:
            new = compare(sighting.pose, sighting.eye, belief, self._config)
            sighting.deviation, _ = self._least([sighting.deviation, new])
        self._misfits.clear()

    def is_fresh(self, now: float) -> bool:
        """Whether the camera saw the object lately."""
        return now - self.last_stamp <= self._config.fresh

    def agrees(self, now: float) -> bool:
        """Whether the newest percepts agree with the belief well, as many as could be surprising."""
        last = self.span()[-DECIDE:]
        if len(last) < DECIDE or not self.is_fresh(now):
            return False
        return not any(disagrees(sighting.deviation, self.bias, 0.5) for sighting in last)

    def misfit(self, false: float = FALSE_FRAME) -> Misfit:
        """How badly the belief explains the newest percepts, of which one is false at a cost of `false` (nats)."""
        if false not in self._misfits:
            self._misfits[false] = misfit([sighting.deviation for sighting in self.span()], self.bias, false)
        return self._misfits[false]

    def reason(self, false: float) -> Reason:
        """In which way the newest percepts contradict the belief most."""
        found = self.misfit(false)
        amount = statistics.median(one.length for one in found.alike)
        return Reason(found.way, describe(found, self.camera), amount)

    @property
    def bias(self) -> DepthBias:
        """The systematic error along the viewing ray, as far as it is known: a Gaussian, by the percepts that agree."""
        prior, noise, left = self._config.depth_bias**2, self._config.depth_noise**2, self._config.learned_bias**2
        if not self._learned or prior + noise == 0.0:
            return DepthBias(0.0, math.sqrt(prior + left))
        share = prior / (prior + noise / self._learned)
        return DepthBias(share * self._offset, math.sqrt((1.0 - share) * prior + left))

    def _prior(self, stamp: float, before: Callable[[float], Pose | None]) -> Pose | None:
        """What was believed before the evidence that a percept of time `stamp` (s) belongs to.

        Evidence that the belief does not agree with is still the same when its first percepts are not kept any more.
        """
        start = self.start(stamp)
        first = next((sighting for sighting in self._sightings if sighting.stamp == start), None)
        if first is not None and disagrees(first.deviation, self.bias):
            return first.prior
        return before(start)

    def _least(self, deviations: Sequence[Deviation]) -> tuple[Deviation, float]:
        """The first of those that noise makes most easily, and what that costs, nats."""
        bias = self.bias
        costs = [disagreement(deviation, bias) for deviation in deviations]
        least = min(costs)
        return deviations[costs.index(least)], least
