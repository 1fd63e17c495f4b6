"""Combines the last percepts of an object from one camera: they contradict the belief, or agree with it.

Single wrong percepts never count: several of the last few must disagree in the same direction, the newest among them.
They are one piece of evidence. How sure the belief was before all of it counts: a belief that contradictions have made
unsure would excuse them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from surprise.config import SurpriseConfig
from surprise.deviation import Deviation, compare
from surprise.limits import WAYS, Way, are_alike, describe, disagrees, exceeds, extent, vector


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
        self._camera = camera
        self._config = config
        self._sightings: deque[DeviationSighting] = deque(maxlen=max(config.window, config.held_window))
        self._offset = 0.0  # m along the viewing ray, mean of the percepts that agree
        self._learned = 0  # percepts of which that is made
        self._contradictions: dict[bool, list[Reason]] = {}  # by whether it is held, until something changes

    @property
    def last_stamp(self) -> float:
        """s, of the newest percept."""
        return self._sightings[-1].stamp if self._sightings else -math.inf

    def stamps(self) -> list[float]:
        """Stamps (s) of the last percepts, the oldest first."""
        return [sighting.stamp for sighting in self._sightings]

    def last(self, count: int) -> list[DeviationSighting]:
        """The newest percepts, at most so many."""
        return list(self._sightings)[-count:]

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
        self._contradictions.clear()
        prior = self._prior(stamp, before) or beliefs[0]
        deviation = self._least([compare(pose, eye, belief, self._config, prior=prior) for belief in beliefs])
        self._sightings.append(DeviationSighting(stamp, pose, eye, deviation, prior))
        if not disagrees(deviation, self.bias, self._config):
            self._learned = min(self._learned + 1, self._config.learn_window)
            self._offset += (deviation.depth - self._offset) / self._learned

    def belief_jumped(self, belief: Pose) -> None:
        """The belief was changed on purpose: earlier percepts count only if they agree with the new one or the old."""
        self._learned, self._offset = 0, 0.0
        self.belief_changed(belief)
        for sighting in list(self._sightings):
            sighting.prior = belief
            if disagrees(sighting.deviation, None, self._config):
                self._sightings.remove(sighting)

    def belief_changed(self, belief: Pose) -> None:
        """Compare the last percepts with a newer belief as well; the one that they fit best counts."""
        self._contradictions.clear()
        for sighting in self._sightings:
            new = compare(sighting.pose, sighting.eye, belief, self._config)
            sighting.deviation = self._least([sighting.deviation, new])

    def forget_old(self, now: float) -> None:
        """Drop percepts that are too old to say anything."""
        while self._sightings and now - self._sightings[0].stamp > self._config.forget_after:
            self._sightings.popleft()
            self._contradictions.clear()

    def is_fresh(self, now: float) -> bool:
        """Whether the camera saw the object lately."""
        return now - self.last_stamp <= self._config.fresh

    def agrees(self, now: float) -> bool:
        """Whether the newest percepts are well within the limits."""
        last = list(self._sightings)[-self._config.needed :]
        if len(last) < self._config.needed or not self.is_fresh(now):
            return False
        share = self._config.hysteresis
        return not any(disagrees(sighting.deviation, self.bias, self._config, share) for sighting in last)

    def contradictions(self, *, held: bool = False) -> list[Reason]:
        """In which ways the last percepts contradict the belief; more of them must, of an object that is held."""
        if held not in self._contradictions:
            self._contradictions[held] = self._find_contradictions(held)
        return self._contradictions[held]

    def _find_contradictions(self, held: bool) -> list[Reason]:
        config = self._config
        needed, window = (config.held_needed, config.held_window) if held else (config.needed, config.window)
        last = [sighting.deviation for sighting in self._sightings][-window:]
        found = []
        for way in WAYS:
            alike = self._alike(way, last)
            if len(alike) >= needed:
                text = describe(way, alike, self.bias, self._camera)
                found.append(Reason(way, text, extent(way, alike, self.bias)))
        return _essential(found)

    def _alike(self, way: Way, last: Sequence[Deviation]) -> list[Deviation]:
        """Those that disagree as the newest does; none if that one agrees."""
        config, bias = self._config, self.bias
        if not last or not exceeds(way, last[-1], bias, config):
            return []
        newest = vector(way, last[-1], bias)
        beyond = [deviation for deviation in last if exceeds(way, deviation, bias, config)]
        return [deviation for deviation in beyond if are_alike(vector(way, deviation, bias), newest, config)]

    @property
    def bias(self) -> float | None:
        """m, the systematic error along the viewing ray; None until it is known."""
        return self._offset if self._learned >= self._config.learn_after else None

    def _prior(self, stamp: float, before: Callable[[float], Pose | None]) -> Pose | None:
        """What was believed before the evidence that a percept of time `stamp` (s) belongs to.

        Evidence that the belief does not agree with is still the same when its first percepts are not kept any more.
        """
        start = self.start(stamp)
        first = next((sighting for sighting in self._sightings if sighting.stamp == start), None)
        if first is not None and disagrees(first.deviation, self.bias, self._config):
            return first.prior
        return before(start)

    def _least(self, deviations: Sequence[Deviation]) -> Deviation:
        return min(deviations, key=lambda deviation: deviation.extent(self._config))


def _essential(reasons: list[Reason]) -> list[Reason]:
    """Without the change of depth that a larger move across the viewing ray entails."""
    across = max((reason.extent for reason in reasons if reason.kind == "beside"), default=0.0)
    return [reason for reason in reasons if reason.kind != "depth" or reason.extent > across]
