"""How a body rolls that is seen to move over a support."""

from __future__ import annotations

import math

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from simulation_handler.physics.rollouts.scene import STILL
from simulation_handler.shapes.geometry import Solid


def rolling(solid: Solid, velocity: Vector3, *, free: bool) -> tuple[Quaternion, Vector3]:
    """Rotation in the world, and spin (rad/s), of a body that moves over a level support without sliding.

    Args:
        solid: the body.
        velocity: (3,) m/s of its centre.
        free: nobody knows how it is turned about the vertical: a cylinder that lies is taken to roll, not to slide.

    What is neither a ball nor a cylinder that lies keeps its rotation, and does not spin.
    """
    x, y, _ = velocity
    speed, radius = math.hypot(x, y), 0.5 * solid.size[0]
    if speed == 0.0 or (solid.is_round and solid.kind != "sphere") or solid.kind not in ("sphere", "cylinder"):
        return solid.rotation, STILL
    across: Vector3 = (-y / speed, x / speed, 0.0)
    rotation, share = solid.rotation, 1.0
    if solid.kind == "cylinder":
        axis = quaternions.rotate(rotation, (0.0, 0.0, 1.0))
        if free:
            turn = math.atan2(across[1], across[0]) - math.atan2(axis[1], axis[0])
            rotation = quaternions.product(quaternions.from_rotvec((0.0, 0.0, turn)), rotation)
        else:
            share = float(np.dot(axis, across))
            across = axis
    a, b, c = (share * speed / radius * value for value in across)
    return rotation, (a, b, c)
