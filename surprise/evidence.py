"""Combines the last percepts of an object from one camera: they contradict the belief, or agree with it.

Single wrong percepts never count: several of the last few must disagree in the same direction, the newest among them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
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

    def add(self, stamp: float, pose: Pose, eye: Vector3, beliefs: Sequence[Pose]) -> None:
        """Take in a percept (world_from_object, seen from `eye`); of several beliefs, the one it fits best counts."""
        self._contradictions.clear()
        deviation = self._least([compare(pose, eye, belief, self._config) for belief in beliefs])
        self._sightings.append(DeviationSighting(stamp, pose, eye, deviation))
        if not disagrees(deviation, self.bias, self._config):
            self._learned = min(self._learned + 1, self._config.learn_window)
            self._offset += (deviation.depth - self._offset) / self._learned

    def belief_jumped(self, belief: Pose) -> None:
        """The belief was changed on purpose: earlier percepts count only if they agree with the new one or the old."""
        self._learned, self._offset = 0, 0.0
        self.belief_changed(belief)
        for sighting in list(self._sightings):
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

    def _least(self, deviations: Sequence[Deviation]) -> Deviation:
        return min(deviations, key=lambda deviation: deviation.extent(self._config))


def _essential(reasons: list[Reason]) -> list[Reason]:
    """Without the change of depth that a larger move across the viewing ray entails."""
    across = max((reason.extent for reason in reasons if reason.kind == "beside"), default=0.0)
    return [reason for reason in reasons if reason.kind != "depth" or reason.extent > across]
