"""Calibration as a function: sightings in, the camera's pose in its parent out, by any of the methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agents.calibrator.solve import closed_form, robust
from agents.calibrator.solve.estimate import Method
from agents.calibrator.solve.problem import ObjectSighting, Problem
from agents.calibrator.solve.solution import CalibrationSolution, judged
from dsr.config.plugins import CALIBRATION_METHODS, load
from dsr.math3d.transforms import Pose
from dsr.vocabulary.calibration import DEFAULT_METHOD, checked_method

METHODS: Mapping[str, Method] = {"robust": robust.solve, "closed_form": closed_form.solve}
"""Methods by name, those of `dsr.vocabulary.calibration.METHODS`."""


def calibrate(
    sightings: Sequence[ObjectSighting], before: Pose, method: str = DEFAULT_METHOD, prior: Pose | None = None
) -> CalibrationSolution:
    """Find the pose of a camera in its parent (a gripper or the world) that makes what it sees agree with the belief.

    Args:
        sightings: of any number of objects, in one or many views.
        before: parent_from_camera as it is believed.
        method: one of `dsr.vocabulary.calibration.method_names()`.
        prior: parent_from_camera, with covariance, before anything was seen; None if the camera may be anywhere.

    Raises:
        ConfigError: for an unknown method.
        ValueError: without sightings, or for a percept without covariance.
    """
    solve: Method = METHODS.get(checked_method(method)) or load(CALIBRATION_METHODS, method)
    problem = Problem(sightings, prior)
    return judged(method, problem, before, solve(problem, before.matrix))
