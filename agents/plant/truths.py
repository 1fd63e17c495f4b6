"""The predicates on the true world that a scenario's conditions are made of."""

from __future__ import annotations

from collections.abc import Callable

from agents.plant.stage import Stage
from agents.scenario.format import Term

LIFTED = 0.010
"""m, the least gap below an object that is lifted"""


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


PREDICATES: dict[str, Callable[..., bool]] = {"built": built, "resting": resting, "lifted": lifted}
"""By their name in a condition."""
