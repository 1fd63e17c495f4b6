"""Finds small steps of a camera: all it sees is displaced at once as by one motion, too little to be surprising."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dsr.frames.tree import WORLD
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.perception.consensus import agree_beyond_chance
from dsr.perception.percepts import PerceptReader
from dsr.vocabulary.relations import THINGS, grasped_things, present_things

REACH = 2.0
"""s before a step is found, from which on beliefs may have followed the step."""
_SPAN = 1.0  # s over which percepts are averaged, before and after
_APART = 1.5  # s between two averages
_PERIOD = 0.3  # s between two comparisons
_LEAST = 6  # percepts in each average
_FLOOR = 0.0003  # m, standard deviation that averages have at least
_STILL = PoseTolerance(0.001, 0.002)  # m, rad that the camera's parent may move meanwhile
_SHIFT = (0.003, 0.02)  # m, mean displacement that is worth looking into, and from which it is surprising anyway
_LEAD = 40.0  # chi-squared that one motion of the camera must explain; of 6 numbers, noise makes 22.5 in a thousandth
_MISFIT = 4.0  # chi-squared per degree of freedom that it may leave


def carried_things(memory: Memory) -> frozenset[str]:
    """Objects that are on or in others, with which they are moved."""
    things = {node.name for node in memory.nodes(THINGS)}
    return frozenset(edge.src for kind in ("on", "in") for edge in memory.edges(kind) if edge.dst in things)


class _Sample(NamedTuple):
    stamp: float
    place: Array  # (3,) m, world


class Steps:
    """Compares percepts of each camera with those just before; systematic errors of percepts are alike in both."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._percepts = PerceptReader(memory, timeless=False)
        self._samples: dict[tuple[str, str], deque[_Sample]] = {}
        self._parents: dict[str, Pose] = {}
        self._compared: dict[str, float] = {}

    def found(self, camera: str, now: float) -> tuple[str, ...]:
        """Take in what `camera` sees at time `now` (s); the objects that are displaced as one, if there are such."""
        self._take(camera, now)
        if now - self._compared.get(camera, -_PERIOD) < _PERIOD:
            return ()
        self._compared[camera] = now
        carried = carried_things(self._memory)
        averages = {
            name: pair
            for (other, name), samples in self._samples.items()
            if other == camera and name not in carried and (pair := _averages(samples, now)) is not None
        }
        return tuple(sorted(averages)) if _is_step(averages) else ()

    def forget(self, camera: str) -> None:
        """Something else happened, after which nothing is as it was before."""
        for key in [key for key in self._samples if key[0] == camera]:
            del self._samples[key]

    def _take(self, camera: str, now: float) -> None:
        world_from_camera = self._memory.get_transform(WORLD, camera)
        if world_from_camera is None:
            return
        before = self._parents.setdefault(camera, world_from_camera)
        if not _STILL.covers(before, world_from_camera):
            self.forget(camera)
            self._parents[camera] = world_from_camera
        held = grasped_things(self._memory)
        here = {node.name for node in present_things(self._memory)}
        for percept in self._percepts.new(now, here - held, (camera,)):
            place = percept.world_from_camera.apply(percept.seen.translation[None])[0]
            self._samples.setdefault((camera, percept.name), deque()).append(_Sample(percept.stamp, place))
        for (other, name), samples in self._samples.items():
            while other == camera and samples and samples[0].stamp < now - _SPAN - _APART:
                samples.popleft()
            if name in held or name not in here:
                samples.clear()


def _averages(percepts: deque[_Sample], now: float) -> tuple[Array, Array, Array] | None:
    """Mean places before and after, and the variances (3,) of their difference; None without enough percepts."""
    new = np.array([one.place for one in percepts if one.stamp > now - _SPAN])
    old = np.array([one.place for one in percepts if one.stamp <= now - _APART])
    if len(new) < _LEAST or len(old) < _LEAST:
        return None
    variances = old.var(axis=0, ddof=1) / len(old) + new.var(axis=0, ddof=1) / len(new) + _FLOOR**2
    return old.mean(axis=0), new.mean(axis=0), variances


def _is_step(averages: Mapping[str, tuple[Array, Array, Array]]) -> bool:
    """Whether a small motion of all of them, as one, explains most of what has changed."""
    if not agree_beyond_chance([False] * len(averages)):
        return False
    old, new, variances = (np.array(column) for column in zip(*averages.values(), strict=True))
    shifts = new - old
    if not _SHIFT[0] <= float(np.linalg.norm(shifts, axis=1).mean()) <= _SHIFT[1]:
        return False
    arms = old - old.mean(axis=0)
    turns = -np.cross(arms[:, None, :], np.eye(3)[None]).transpose(0, 2, 1)
    weights = 1.0 / np.sqrt(variances.ravel())
    design = np.concatenate([np.tile(np.eye(3), (len(old), 1, 1)), turns], axis=2).reshape(-1, 6) * weights[:, None]
    target = shifts.ravel() * weights
    rest = target - design @ np.linalg.lstsq(design, target, rcond=None)[0]
    left, freedom = float(rest @ rest), max(len(target) - 6, 1)
    return float(target @ target) - left >= _LEAD and left <= _MISFIT * freedom
