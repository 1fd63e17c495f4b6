"""What the experimenter's moves do: one generator each, which advances by one step of physics at a time.

A new move is a struct in the scenario format and a generator function here, registered with `move`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from agents.plant.stage import Grip, Stage
from agents.plant.world import STEP, upright, yaw_of
from agents.scenario.format import CameraBump, CameraCover, Carry, Drop, Event, Lift, Place, Remove, Slide, Tilt
from dsr import quaternions
from dsr.transforms import Pose, interpolate

TURN_SPEED = 2.0
"""rad/s, when an object is turned on its way"""

Steps = Iterator[None]
Move = Callable[[Any, Stage], Steps]
"""Called with the event; each item is a step of physics."""
MOVES: dict[type[Event], Move] = {}
"""What to do for each kind of event."""


def move(kind: type[Event]) -> Callable[[Move], Move]:
    """Register a move for the events of `kind`."""

    def register(function: Move) -> Move:
        MOVES[kind] = function
        return function

    return register


@move(Place)
def place(event: Place, stage: Stage) -> Steps:
    """Put the object down elsewhere at once."""
    world = stage.world
    yaw = event.yaw if event.yaw is not None else yaw_of(world.pose(event.object)) if event.object in world else 0.0
    position = event.position
    if event.onto is not None:
        x, y, z = world.pose(event.onto).t
        height = (world.specs[event.onto].size[2] + world.specs[event.object].size[2]) / 2
        position = (x + event.offset[0], y + event.offset[1], z + height)
    assert position is not None  # the format demands one of both
    stage.free(event.object)
    world.put(event.object, upright(position, yaw))
    yield from ()


@move(Slide)
def slide(event: Slide, stage: Stage) -> Steps:
    """Push the object over its support."""
    grip = stage.take(event.object, contents=event.contents)
    position = (*event.to, grip.pose.t[2])
    turn = 0.0 if event.yaw is None else event.yaw - yaw_of(grip.pose)
    yield from _follow(grip, Pose(position, _turned(grip.pose, turn)), event.speed)
    stage.release(event.object)


@move(Carry)
def carry(event: Carry, stage: Stage) -> Steps:
    """Lift the object, move it over its goal, put it down there upright."""
    grip = stage.take(event.object, contents=event.contents)
    yaw = yaw_of(grip.pose) if event.yaw is None else event.yaw
    x, y, z = grip.pose.t
    top = max(z, event.to[2]) + event.height
    yield from _follow(grip, Pose((x, y, top), grip.pose.q), event.speed)
    yield from _follow(grip, upright((event.to[0], event.to[1], top), yaw), event.speed)
    yield from _follow(grip, upright(event.to, yaw), event.speed)
    stage.release(event.object)


@move(Lift)
def lift(event: Lift, stage: Stage) -> Steps:
    """Raise the object and keep hold of it."""
    grip = stage.take(event.object, contents=event.contents)
    x, y, z = grip.pose.t
    yield from _follow(grip, Pose((x, y, z + event.height), grip.pose.q), event.speed)


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
    """Let go."""
    stage.release(event.object)
    yield from ()


@move(Remove)
def remove(event: Remove, stage: Stage) -> Steps:
    """Take the object out of the scene."""
    stage.free(event.object)
    stage.world.remove(event.object)
    yield from ()


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


def _follow(grip: Grip, goal: Pose, speed: float) -> Steps:
    """Straight to `goal` at `speed` m/s, turning evenly on the way."""
    start = grip.pose
    distance, angle = start.distance(goal)
    steps = max(1, math.ceil(max(distance / speed, angle / TURN_SPEED) / STEP))
    first, last = start.with_stamp(0.0), goal.with_stamp(1.0)
    for step in range(1, steps + 1):
        grip.move_to(interpolate(first, last, step / steps))
        yield


def _turned(pose: Pose, angle: float) -> quaternions.Quaternion:
    """The rotation of `pose`, turned further by `angle` rad about the vertical."""
    return quaternions.product(quaternions.from_rotvec((0.0, 0.0, angle)), pose.q)
