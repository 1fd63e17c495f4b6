"""What has come into the way of an arm since the way was planned: things and zones that are new, moved or grew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.arm_controller.motion.obstacles import MARGIN
from agents.arm_controller.scene import Obstacle
from dsr.math3d.boxes import CORNERS, Array

LEAST_MOVE = MARGIN
"""m that a corner of a thing may move: ways keep as far away from it; a belief moves by some mm with each percept"""
LIKELY = 3.0
"""Standard deviations that a corner may move beside that: an unmoved thing exceeds them once in 370 percepts"""


class Intrusions(NamedTuple):
    """What is believed to be elsewhere than where a way was planned around it."""

    moved: list[Obstacle]
    """What is new, or moved by more than what was known of its place explains. Each change is told once."""
    doubtful: list[Obstacle]
    """What may stand where it stood: its place was known so badly. It is told as long as that lasts."""


class Intruders:
    """Compares what is believed to be around an arm with what a way was planned around.

    A place that was known badly is expected to change when it becomes known better, although nothing moves. Its
    covariance at the time of the plan tells by how much. Its covariance now does not count: of a thing that was taken
    away, nobody knows well at first where it is.
    """

    def __init__(self) -> None:
        self._known: dict[str, Obstacle] = {}

    def expect(self, things: Sequence[Obstacle]) -> None:
        """Take these things as those that a way was planned around."""
        self._known = {thing.name: thing for thing in things}

    def among(self, things: Sequence[Obstacle]) -> Intrusions:
        """Those of the things that are not where, or as large as, they were."""
        changes = Intrusions([], [])
        for thing in things:
            known = self._known.get(thing.name)
            if known is not None and (known == thing or (way := _Way(known, thing)).is_short):
                continue
            if known is not None and way.is_likely:
                changes.doubtful.append(thing)
            else:
                changes.moved.append(thing)
                self._known[thing.name] = thing
        return changes


class _Way:
    """By how much the corners of the box of a thing moved: as that was shifted or turned, or grew."""

    def __init__(self, before: Obstacle, now: Obstacle) -> None:
        self._before = before
        self._ways: Array = _corners(now) - _corners(before)
        self._lengths: Array = np.linalg.norm(self._ways, axis=1)

    @property
    def is_short(self) -> bool:
        return bool(self._lengths.max() <= LEAST_MOVE)

    @property
    def is_likely(self) -> bool:
        """Whether a thing that stands still may be believed to move so far, by the covariance of its pose before."""
        if self._before.pose.cov is None:
            return False
        shift, turn = self._before.pose.parent_covariances()
        arms = _corners(self._before) - np.array(self._before.pose.t)
        far = self._lengths > LEAST_MOVE
        along = self._ways[far] / self._lengths[far, None]
        across = np.cross(arms[far], along)
        variances = np.einsum("ki,ij,kj->k", along, shift, along) + np.einsum("ki,ij,kj->k", across, turn, across)
        return bool((self._lengths[far] <= LIKELY * np.sqrt(np.maximum(variances, 0.0))).all())


def _corners(thing: Obstacle) -> Array:
    return thing.pose.apply(CORNERS * thing.size * 0.5)
