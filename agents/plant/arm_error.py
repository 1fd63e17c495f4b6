"""Joint positions of an arm whose sensors err: those at which its tool would be a little elsewhere."""

from __future__ import annotations

import numpy as np

from agents.plant.arm import Arm
from dsr.math3d.quaternions import Vector3

TOOL_LINK = "tool_link"
"""Link of the URDF whose place the error is about."""
_DAMPING = 1e-3  # m, keeps the joints' errors small near a singularity


def displaced(arm: Arm, translation: Vector3) -> tuple[float, ...]:
    """The positions (rad) at which the tool would be `translation` m (world) from where it is, turned as it is.

    One step of damped least squares with the tool's Jacobian (Buss and Kim 2005): right to first order, that is to
    about 0.6 mm for 15 mm.
    """
    jacobian = arm.jacobian(TOOL_LINK)
    square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(6)
    change = jacobian.T @ np.linalg.solve(square, np.array([*translation, 0.0, 0.0, 0.0]))
    return tuple((np.array(arm.positions) + change).tolist())
