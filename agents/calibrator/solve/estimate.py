"""The interface of a method of calibration: its arguments and its result."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agents.calibrator.solve.problem import Problem
from dsr.math3d.transforms import Array


class PoseEstimate(NamedTuple):
    """A camera pose that a method found."""

    pose: Array
    """(4, 4) parent_from_camera"""
    history: tuple[float, ...]
    """The mean distance of Equation 1 (see `equation_1`) at the beginning and after each iteration."""


Method = Callable[[Problem, Array], PoseEstimate]
"""Finds the camera pose, given the present one (4, 4)."""


def equation_1(problem: Problem, pose: Array) -> float:
    """Equation 1 of the CORTEX paper (section 4.2), averaged over the sightings, with its sign corrected.

    1 - <q, q'>^2 + |t - t'|, with t in m; as printed, the first term grows as the rotations get more alike.
    """
    found = pose @ problem.seen
    offsets = found[:, :3, 3] - problem.believed[:, :3, 3]
    traces = (found[:, :3, :3] * problem.believed[:, :3, :3]).sum(axis=(1, 2))  # 1 - <q, q'>^2 = (3 - trace) / 4
    return float((0.25 * (3.0 - traces) + np.sqrt((offsets**2).sum(axis=1))).mean())
