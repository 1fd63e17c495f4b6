"""Scenes for the tests of forward simulation: a floor, a table, and cubes on it."""

from __future__ import annotations

import numpy as np

from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene

CUBE = (0.04, 0.04, 0.04)
FLOOR = RolloutBody("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.8), friction=0.5, fixed=True)
TABLE = RolloutBody("table", (1.0, 1.0, 0.05), (0.0, 0.0, -0.025), friction=0.5, fixed=True)


def cube(name: str, x: float, y: float, z: float = 0.02) -> RolloutBody:
    return RolloutBody(name, CUBE, (x, y, z), mass=0.05, friction=0.5)


def scene_of(*bodies: RolloutBody) -> RolloutScene:
    return RolloutScene((FLOOR, TABLE, *bodies))


def random_scene(seed: int) -> RolloutScene:
    """Stacks of up to three cubes that fit badly; some cubes are missing, some are held."""
    rng = np.random.default_rng(seed)
    bodies = []
    for number in range(rng.integers(2, 8)):
        column, level = divmod(number, 3)
        dx, dy, dz = rng.normal(0.0, 0.003, 3).tolist()
        x, y, z, w = (np.array([0.0, 0.0, 0.0, 1.0]) + rng.normal(0.0, 0.01, 4)).tolist()
        body = cube(f"cube_{number}", 0.1 * column + dx, dy, 0.02 + 0.0402 * level + abs(dz))
        body = body._replace(rotation=(x, y, z, w), fixed=bool(rng.random() < 0.2))
        if rng.random() < 0.8:
            bodies.append(body)
    return scene_of(*bodies)
