"""Moves of persons: they come, turn the head, walk and leave."""

from __future__ import annotations

import math

from agents.plant.moves import Move, Steps
from agents.plant.persons import Person, gaze
from agents.plant.stage import Stage
from agents.plant.world import STEP
from agents.scenario.format.scenario import Event, PersonEnter, PersonLeave, PersonTurn, PersonWalk
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose, interpolate

_TURN_SPEED = 2.0  # rad/s, of a head on a walk


def enter(event: PersonEnter, stage: Stage) -> Steps:
    """A person is there from now on."""
    person = stage.persons[event.person]
    spec = person.spec
    person.pose = gaze(event.position or spec.position, event.look_at or spec.look_at)
    person.is_present = True
    yield from ()


def turn(event: PersonTurn, stage: Stage) -> Steps:
    """A person looks elsewhere."""
    person = _present(stage, event.person)
    goal = gaze(person.pose.t, event.look_at)
    yield from _reach(person, goal, person.pose.distance(goal)[1] / event.speed)


def walk(event: PersonWalk, stage: Stage) -> Steps:
    """A person goes elsewhere."""
    person = _present(stage, event.person)
    goal = Pose(event.to, person.pose.q) if event.look_at is None else gaze(event.to, event.look_at)
    distance, angle = person.pose.distance(goal)
    yield from _reach(person, goal, max(distance / event.speed, angle / _TURN_SPEED))


def leave(event: PersonLeave, stage: Stage) -> Steps:
    """A person is gone."""
    _present(stage, event.person).is_present = False
    yield from ()


def _reach(person: Person, goal: Pose, seconds: float) -> Steps:
    start, end = person.pose.with_stamp(0.0), goal.with_stamp(1.0)
    steps = max(1, math.ceil(seconds / STEP))
    for step in range(1, steps + 1):
        person.pose = interpolate(start, end, step / steps)
        yield


def _present(stage: Stage, name: str) -> Person:
    person = stage.persons[name]
    if not person.is_present:
        raise ConfigError(f"person {name!r} is not in the scene; expected person_enter before")
    return person


PERSON_MOVES: dict[type[Event], Move] = {PersonEnter: enter, PersonTurn: turn, PersonWalk: walk, PersonLeave: leave}
"""The move for each kind of event."""
