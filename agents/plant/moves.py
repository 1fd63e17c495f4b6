"""Moves of the experimenter: one generator each, which advances by one step of physics at a time.

A new move is a struct in the scenario format and a generator function here, registered with `move`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from agents.plant.camera import Illusion
from agents.plant.stage import RigidGrip, Stage
from agents.plant.world import STEP, upright, yaw_of
from agents.scenario.format.scenario import (
    ArmError,
    CameraBump,
    CameraCover,
    Carry,
    Drop,
    Event,
    FalsePercept,
    Lift,
    PlaceEvent,
    Remove,
    Slide,
    Swap,
    Tilt,
)
from dsr.errors import ConfigError
from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose, interpolate

TURN_SPEED = 2.0
"""rad/s, when an object is turned on its way"""
ERROR_RAMP = 0.2
"""s in which an error of the arm's sensors grows and vanishes"""

Steps = Iterator[None]
Move = Callable[[Any, Stage], Steps]
"""Called with the event; each item is a step of physics."""
MOVES: dict[type[Event], Move] = {}
"""The move for each kind of event."""


def move(kind: type[Event]) -> Callable[[Move], Move]:
    """Register a move for the events of `kind`."""

    def register(function: Move) -> Move:
        MOVES[kind] = function
        return function

    return register


@move(PlaceEvent)
def place(event: PlaceEvent, stage: Stage) -> Steps:
    """Put the object down elsewhere at once."""
    world = stage.world
    yaw = event.yaw if event.yaw is not None else yaw_of(world.pose(event.object)) if event.object in world else 0.0
    position = event.position
    if event.onto is not None:
        x, y, z = world.pose(event.onto).t
        height = (world.specs[event.onto].size[2] + world.specs[event.object].size[2]) / 2
        position = (x + event.offset[0], y + event.offset[1], z + height)
    assert position is not None  # the format demands one of both
    _put(stage, event.object, upright(position, yaw), contents=event.contents)
    yield from ()


@move(Swap)
def swap(event: Swap, stage: Stage) -> Steps:
    """Each stands where the other stood, at the height that its own size asks for."""
    world, first, second = stage.world, event.object, event.other
    heights = {name: world.specs[name].size[2] / 2 for name in (first, second)}
    places = {name: world.pose(name) for name in (first, second)}
    supported = {name: world.supported(name) if event.contents else [] for name in (first, second)}
    if second in supported[first] or first in supported[second]:
        raise ConfigError(f"{first!r} and {second!r} stand on one another: they can only swap without contents")
    offsets = {
        name: [(carried, places[name].inverse() @ world.pose(carried)) for carried in supported[name]]
        for name in places
    }
    for name, other in ((first, second), (second, first)):
        x, y, z = places[other].t
        goal = Pose((x, y, z - heights[other] + heights[name]), places[name].q)
        _set_down(stage, [(name, goal), *((carried, goal @ offset) for carried, offset in offsets[name])])
    yield from ()


@move(Slide)
def slide(event: Slide, stage: Stage) -> Steps:
    """Push the object over its support."""
    grip = stage.take(event.object, contents=event.moves_contents)
    x, y, z = grip.pose.t
    by = event.by or (0.0, 0.0)
    position = (*event.to, z) if event.to is not None else (x + by[0], y + by[1], z)
    turn = event.turn if event.yaw is None else event.yaw - yaw_of(grip.pose)
    yield from follow(grip, Pose(position, turned(grip.pose, turn)), event.speed)
    stage.release(event.object)


@move(Carry)
def carry(event: Carry, stage: Stage) -> Steps:
    """Lift the object, move it over its goal, put it down there upright."""
    grip = stage.take(event.object, contents=event.moves_contents)
    yaw = yaw_of(grip.pose) if event.yaw is None else event.yaw
    x, y, z = grip.pose.t
    top = max(z, event.to[2]) + event.height
    yield from follow(grip, Pose((x, y, top), grip.pose.q), event.speed)
    yield from follow(grip, upright((event.to[0], event.to[1], top), yaw), event.speed)
    yield from follow(grip, upright(event.to, yaw), event.speed)
    stage.release(event.object)


@move(Lift)
def lift(event: Lift, stage: Stage) -> Steps:
    """Raise the object and keep hold of it."""
    grip = stage.take(event.object, contents=event.moves_contents)
    x, y, z = grip.pose.t
    yield from follow(grip, Pose((x, y, z + event.height), grip.pose.q), event.speed)


@move(Tilt)
def tilt(event: Tilt, stage: Stage) -> Steps:
    """Turn the object about its centre and keep hold of it; what is on or in it is free to fall."""
    grip = stage.take(event.object, contents=False)
    length = math.hypot(*event.axis)
    axis = event.axis if length > 0 else (1.0, 0.0, 0.0)
    start = grip.pose
    steps = max(1, math.ceil(abs(event.angle) / event.speed / STEP))
    for step in range(1, steps + 1):
        angle = event.angle * step / steps / (length or 1.0)
        turn = quaternions.from_rotvec((angle * axis[0], angle * axis[1], angle * axis[2]))
        grip.move_to(Pose(start.t, quaternions.product(turn, start.q)))
        yield


@move(Drop)
def drop(event: Drop, stage: Stage) -> Steps:
    """Let go of the object, which then falls."""
    if not stage.holds(event.object):
        raise ConfigError(f"nobody holds {event.object!r}; expected `lift`, `tilt` or a hand that takes it before")
    stage.release(event.object)
    yield from ()


@move(Remove)
def remove(event: Remove, stage: Stage) -> Steps:
    """Take the object out of the scene."""
    stage.free(event.object)
    stage.world.remove(event.object)
    yield from ()


@move(FalsePercept)
def show_falsely(event: FalsePercept, stage: Stage) -> Steps:
    """Let the next frames of the camera show the object elsewhere, until it is taken out of the scene."""
    stage.world.body(event.object)  # what is not there is not shown
    illusion = Illusion(event.frames, event.translation, quaternions.from_rotvec(event.rotation))
    shown = stage.camera(None).illusions
    shown[event.object] = illusion
    while shown.get(event.object) is illusion:
        if event.object not in stage.world:
            del shown[event.object]
            return
        yield


@move(ArmError)
def mislead_arm(event: ArmError, stage: Stage) -> Steps:
    """Let the joint sensors err for a while, smoothly."""
    before = stage.arm_error
    steps = math.ceil(event.duration / STEP)
    for step in range(steps):
        share = min(1.0, step * STEP / ERROR_RAMP, (steps - step) * STEP / ERROR_RAMP)
        x, y, z = event.translation
        stage.arm_error = (before[0] + share * x, before[1] + share * y, before[2] + share * z)
        yield
    stage.arm_error = before


@move(CameraBump)
def bump_camera(event: CameraBump, stage: Stage) -> Steps:
    """Move the true camera."""
    stage.camera(event.camera).bump(Pose.from_rotvec(event.translation, event.rotation))
    yield from ()


@move(CameraCover)
def cover_camera(event: CameraCover, stage: Stage) -> Steps:
    """Cover the lens for a while."""
    camera = stage.camera(event.camera)
    camera.covers += 1
    for _ in range(math.ceil(event.duration / STEP)):
        yield
    camera.covers -= 1


def _put(stage: Stage, name: str, goal: Pose, *, contents: bool) -> None:
    """Teleport an object, or bring it back, at rest."""
    world = stage.world
    supported = world.supported(name) if contents and name in world else []
    offsets = [(carried, world.pose(name).inverse() @ world.pose(carried)) for carried in supported]
    _set_down(stage, [(name, goal), *((carried, goal @ offset) for carried, offset in offsets)])


def _set_down(stage: Stage, goals: list[tuple[str, Pose]]) -> None:
    for name, goal in goals:
        stage.free(name)
        stage.world.put(name, goal)


def follow(grip: RigidGrip, goal: Pose, speed: float) -> Steps:
    """Straight to `goal` at `speed` m/s, turning evenly on the way."""
    start = grip.pose
    distance, angle = start.distance(goal)
    steps = max(1, math.ceil(max(distance / speed, angle / TURN_SPEED) / STEP))
    first, last = start.with_stamp(0.0), goal.with_stamp(1.0)
    for step in range(1, steps + 1):
        grip.move_to(interpolate(first, last, step / steps))
        yield


def turned(pose: Pose, angle: float) -> quaternions.Quaternion:
    """The rotation of `pose`, turned further by `angle` rad about the vertical."""
    return quaternions.product(quaternions.from_rotvec((0.0, 0.0, angle)), pose.q)
