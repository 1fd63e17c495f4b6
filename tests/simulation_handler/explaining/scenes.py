"""Perturbations of small scenes with towers, seen from above, and how the belief fares after them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dsr.math3d.transforms import Pose
from tests.simulation_handler.worlds import PERIOD, World, cube_at

CLOSE = 0.005
"""m, how close the belief must be to the truth"""


@dataclass(frozen=True)
class Aftermath:
    """What became of a belief after a perturbation."""

    recovered_after: float | None
    """s until all beliefs, of unseen objects too, came within `CLOSE` to stay; None if they did not."""
    explanations: tuple[str, ...]
    errors: dict[str, float]
    """m at the end"""
    relations: set[tuple[str, str]]


def two_towers(seed: int = 0, policy: str = "hypotheses") -> World:
    """Cube 3 on 4 and 6 on 5, built under the eyes of the camera."""
    start = {"cube_4": cube_at(0.30, 0.08), "cube_5": cube_at(0.30, -0.08)}
    world = World(
        start | {"cube_3": cube_at(0.42, 0.08), "cube_6": cube_at(0.42, -0.08)}, seed, rays=True, policy=policy
    )
    world.run(2.0)
    offsets = np.random.default_rng(seed).uniform(-0.003, 0.003, 4)
    world.truths["cube_3"] = cube_at(0.30 + offsets[0], 0.08 + offsets[1], 0.06, 0.1)
    world.run(1.5)
    world.truths["cube_6"] = cube_at(0.30 + offsets[2], -0.08 + offsets[3], 0.06, -0.1)
    world.run(1.5)
    world.belief.explanations()
    return world


def tower(height: int, seed: int = 0, others: dict[str, Pose] | None = None) -> World:
    """Cubes c0, c1, ... stacked one after the other."""
    cubes = {f"c{i}": cube_at(0.26 + 0.06 * i, -0.15) for i in range(height)}
    world = World(cubes | (others or {}), seed, rays=True)
    world.run(2.0)
    rng = np.random.default_rng(seed)
    for level in range(1, height):
        dx, dy = rng.uniform(-0.003, 0.003, 2)
        world.truths[f"c{level}"] = cube_at(0.26 + dx, -0.15 + dy, 0.02 + 0.04 * level, rng.uniform(-0.3, 0.3))
        world.run(1.2)
    world.belief.explanations()
    return world


def shift(world: World, names: list[str], dx: float, dy: float, dz: float = 0.0) -> None:
    """Move true objects rigidly, at once."""
    for name in names:
        x, y, z = world.truths[name].t
        world.truths[name] = Pose((x + dx, y + dy, z + dz), world.truths[name].q)


def after(world: World, perturb: Callable[[World], None], seconds: float = 2.5) -> Aftermath:
    """Perturb a world, then watch for some seconds."""
    perturb(world)
    texts = [explanation.text for _, explanation in world.belief.explanations()]
    close_since: float | None = None
    for tick in range(round(seconds / PERIOD)):
        world.tick()
        texts += [explanation.text for _, explanation in world.belief.explanations()]
        if max(errors(world).values()) > CLOSE:
            close_since = None
        elif close_since is None:
            close_since = (tick + 1) * PERIOD
    return Aftermath(close_since, tuple(texts), errors(world), set(world.belief.supports()))


def errors(world: World) -> dict[str, float]:
    """Distance (m) of each belief from the truth; infinite where there is none."""
    return {name: math.inf if world.belief.pose(name) is None else world.error(name) for name in world.truths}
