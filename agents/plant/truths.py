"""The predicates on the true world that a scenario's conditions are made of."""

from __future__ import annotations

import math
from collections.abc import Callable

from agents.plant.stage import Stage
from agents.scenario.format import Term

LIFTED = 0.010
"""m, the least gap below an object that is lifted"""
LOWERED = 0.020
"""m, the largest gap below an object that is being lowered"""
STILL_JOINT = 0.01
"""rad/s, the largest velocity of a joint that stands still"""


def is_true(term: Term, stage: Stage) -> bool:
    """Whether a term of a condition holds now; false when one of its objects is not in the scene."""
    return all(name in stage.world for name in term.objects) and PREDICATES[term.predicate](stage, *term.objects)


def built(stage: Stage, upper: str, lower: str) -> bool:
    """`upper` stands on `lower`, nobody holds them and neither moves."""
    world = stage.world
    left_alone = not (stage.is_held(upper) or stage.is_held(lower))
    return left_alone and world.is_still(upper) and world.is_still(lower) and world.body(lower) in world.supports(upper)


def resting(stage: Stage, name: str) -> bool:
    """The object is supported, nobody holds it and it does not move."""
    return not stage.is_held(name) and stage.world.is_still(name) and bool(stage.world.supports(name))


def lifted(stage: Stage, name: str) -> bool:
    """The object is more than `LIFTED` above whatever lies below it."""
    return not stage.world.has_below(name, LIFTED)


def held(stage: Stage, name: str) -> bool:
    """The object is in the gripper."""
    return stage.arm.held == name


def lowering(stage: Stage, upper: str, lower: str) -> bool:
    """The gripper holds `upper` over `lower`, its bottom less than `LOWERED` above the other's top."""
    if stage.arm.held != upper:
        return False
    (x, y, z), (x_below, y_below, z_below) = stage.world.pose(upper).t, stage.world.pose(lower).t
    sizes = stage.world.specs[upper].size, stage.world.specs[lower].size
    gap = z - z_below - (sizes[0][2] + sizes[1][2]) / 2
    return math.hypot(x - x_below, y - y_below) < min(sizes[1][:2]) / 2 and 0.0 < gap < LOWERED


def idle(stage: Stage) -> bool:
    """The gripper holds nothing and the arm does not move."""
    return stage.arm.held is None and max(map(abs, stage.arm.velocities), default=0.0) < STILL_JOINT


PREDICATES: dict[str, Callable[..., bool]] = {
    "built": built,
    "resting": resting,
    "lifted": lifted,
    "held": held,
    "lowering": lowering,
    "idle": idle,
}
"""By their name in a condition."""
PASSING = frozenset({"lowering"})
"""Predicates on motion, which need not last to count."""
