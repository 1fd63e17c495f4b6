"""The method of the CORTEX paper: Powell's minimisation of Equation 1 over the six numbers of the camera pose."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from agents.calibrator.solve.estimate import PoseEstimate, equation_1
from agents.calibrator.solve.problem import Problem
from dsr.math3d.transforms import Array

Values = np.ndarray[tuple[int], np.dtype[np.float64]]


def solve(problem: Problem, start: Array) -> PoseEstimate:
    """Minimise from the present pose on, with SciPy's own tolerances; it may end in a local minimum."""
    roll, pitch, yaw = Rotation.from_matrix(start[:3, :3]).as_euler("xyz")
    history = [equation_1(problem, start)]

    def error(values: Values) -> float:
        return equation_1(problem, _pose(values))

    def note(xk: Values) -> None:
        history.append(error(xk))

    first: Values = np.array([*start[:3, 3].tolist(), roll, pitch, yaw], dtype=np.float64)
    found = minimize(error, first, method="Powell", callback=note)
    return PoseEstimate(_pose(found.x), tuple(history))


def _pose(values: Values) -> Array:
    """(4, 4) of x, y, z (m) and roll, pitch, yaw (rad, about fixed axes)."""
    x, y, z, roll, pitch, yaw = np.ravel(values).tolist()
    ca, sa, cb, sb, cc, sc = (f(angle) for angle in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array([
        (cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa, x),
        (sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa, y),
        (-sb, cb * sa, cb * ca, z),
        (0.0, 0.0, 0.0, 1.0),
    ])  # fmt: skip
