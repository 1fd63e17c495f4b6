"""Calibration as a function: sightings in, the camera's pose in its parent out, by any of the methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agents.calibrator import closed_form, powell, robust
from agents.calibrator.estimate import Method
from agents.calibrator.problem import Problem, Sighting
from agents.calibrator.solution import Solution, judged
from dsr.calibration import DEFAULT_METHOD, checked_method
from dsr.transforms import Pose

METHODS: Mapping[str, Method] = {
    "robust": robust.solve, "closed_form": closed_form.solve, "powell": powell.solve,
}  # fmt: skip
"""By name, those of `dsr.calibration.METHODS`."""


def calibrate(sightings: Sequence[Sighting], before: Pose, method: str = DEFAULT_METHOD) -> Solution:
    """Find the pose of a camera in its parent (a gripper or the world) that makes what it sees agree with the belief.

    Args:
        sightings: of any number of objects, in one or many views.
        before: parent_from_camera as it is believed.
        method: one of `METHODS`.

    Raises:
        ConfigError: for an unknown method.
        ValueError: without sightings, or for a percept without covariance.
    """
    solve = METHODS[checked_method(method)]
    problem = Problem(sightings)
    return judged(method, problem, before, solve(problem, before.matrix))
