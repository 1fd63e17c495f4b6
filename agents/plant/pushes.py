"""Moves that set an object in motion and leave the rest to physics: topple, push and roll."""

from __future__ import annotations

import math

from agents.plant.moves import Move, Steps
from agents.plant.stage import Stage
from agents.plant.world import STEP
from agents.scenario.format import Event, Push, Roll, Topple

_PUSHED_OVER = 0.55  # of an object's diagonal, by which it is pushed before it falls by itself


def topple(event: Topple, stage: Stage) -> Steps:
    """Push at its centre until that is beyond the edge; gravity does the rest."""
    world, name = stage.world, event.object
    stage.free(name)
    length = math.hypot(*event.direction)
    along = (event.direction[0] / length, event.direction[1] / length) if length > 0 else (1.0, 0.0)
    start = world.pose(name).t
    reach = _PUSHED_OVER * math.hypot(*world.specs[name].size[:2])
    for _ in range(math.ceil(2 * reach / event.speed / STEP)):
        x, y, _z = world.pose(name).t
        if (x - start[0]) * along[0] + (y - start[1]) * along[1] >= reach:
            return
        world.push(name, (event.speed * along[0], event.speed * along[1]))
        yield


def push(event: Push, stage: Stage) -> Steps:
    """Change the velocity of the object at once."""
    stage.free(event.object)
    velocity, spin = stage.world.velocity(event.object)
    if event.velocity is not None:
        velocity = event.velocity
    elif event.impulse is not None:
        mass = stage.world.specs[event.object].mass
        x, y, z = (now + change / mass for now, change in zip(velocity, event.impulse, strict=True))
        velocity = (x, y, z)
    stage.world.launch(event.object, velocity, spin)
    yield from ()


def roll(event: Roll, stage: Stage) -> Steps:
    """Let the ball move and turn so that its lowest point stands still."""
    stage.free(event.object)
    radius = stage.world.specs[event.object].size[2] / 2
    x, y = event.velocity
    stage.world.launch(event.object, (x, y, 0.0), (-y / radius, x / radius, 0.0))
    yield from ()


PUSHES: dict[type[Event], Move] = {Topple: topple, Push: push, Roll: roll}
"""What to do for each kind of event."""
