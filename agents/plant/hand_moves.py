"""Moves of hands: those of a hand itself, and the other moves carried out by a hand."""

from __future__ import annotations

import math

import numpy as np

from agents.plant.hand_figure import palm_pose, relaxed
from agents.plant.hand_grips import OPENED, PITCH, HandGrip, take
from agents.plant.hand_ways import opened, way, withdrawn
from agents.plant.hands import Array, SimulatedHand, Style
from agents.plant.moves import MOVES, TURN_SPEED, Move, Steps, follow, move, turned
from agents.plant.person_moves import PERSON_MOVES
from agents.plant.stage import Stage
from agents.plant.world import STEP
from agents.scenario.format.scenario import (
    Carry,
    Drop,
    Event,
    HandEnter,
    HandGraspEvent,
    HandLeave,
    HandMove,
    HandRelease,
    Lift,
    Push,
    Roll,
    SetInMotion,
    Slide,
    Tilt,
    Topple,
)
from dsr.errors import ConfigError
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose, interpolate

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
"""The move for each kind of event."""


COMES_FROM = 0.35
"""m, distance between the place where a hand first shows and its goal"""
FINGER_SPEED = 0.1
"""m/s, of a fingertip in the palm's frame"""
HAND_SPEED = 0.4
"""m/s, speed of a hand that comes to do another move"""
_RISEN = 0.08  # m, how much higher a hand comes and leaves


ByHand = Slide | Carry | Lift | Tilt | Topple | SetInMotion
"""Moves that a hand can make."""


def begin(event: Event, stage: Stage) -> Steps:
    """The steps of any event: with `hand`, that hand comes, does it and lets go of what it does not keep.

    One that the runner carries out takes none.
    """
    if event.by_runner:
        return iter(())
    steps = {**MOVES, **PUSHES, **PERSON_MOVES}[type(event)](event, stage)
    if isinstance(event, ByHand) and event.hand is not None:
        return _by_hand(event, event.hand, stage, steps)
    return _dropped(event, stage, steps) if isinstance(event, Drop) else steps


@move(HandEnter)
def enter(event: HandEnter, stage: Stage) -> Steps:
    """A hand comes into the scene, open."""
    hand = stage.hands[event.hand]
    _appear(hand, palm_pose(event.position, event.side, PITCH), event.side)
    yield from _reach(hand, palm_pose(event.position, event.side, PITCH), relaxed(hand.side), event.speed)


@move(HandGraspEvent)
def grasp(event: HandGraspEvent, stage: Stage) -> Steps:
    """A hand goes to an object and closes on it."""
    hand = stage.hands[event.hand]
    yield from _grasp(stage, hand, event.object, event.style, event.side, event.above, event.speed)


@move(HandMove)
def move_hand(event: HandMove, stage: Stage) -> Steps:
    """A hand goes somewhere, with what it holds."""
    hand = _present(stage, event.hand)
    if hand.held is None:
        goal = _goal(hand.pose, event)
        yield from _reach(hand, goal, hand.tips, event.speed)
        return
    name = hand.held
    grip = stage.take(name, contents=False)
    yield from follow(grip, _goal(grip.pose, event), event.speed)
    if hand.style == "touch":
        stage.release(name)


@move(HandRelease)
def release(event: HandRelease, stage: Stage) -> Steps:
    """A hand opens; what it held stays, or falls."""
    yield from _release(stage, _present(stage, event.hand))


@move(HandLeave)
def leave(event: HandLeave, stage: Stage) -> Steps:
    """Let a hand go back to where it came from, and vanish."""
    hand = _present(stage, event.hand)
    if hand.held is not None:
        yield from _release(stage, hand)
    yield from _go(stage, hand, _away(hand.pose, event.side or hand.from_side), relaxed(hand.side), event.speed)
    hand.leave()


def _by_hand(event: ByHand, number: int, stage: Stage, steps: Steps) -> Steps:
    hand, name = stage.hands[number], event.object
    had = hand.is_present and hand.held == name
    if isinstance(event, Topple | SetInMotion):
        x, y = event.direction if isinstance(event, Topple) else event.along[:2]
        behind = (-x, -y)
        yield from _grasp(stage, hand, name, "touch", behind, None, HAND_SPEED)
        yield from _pushing(stage, hand, name, steps)
        yield from _release(stage, hand)
        return
    if not had:
        side = hand.from_side if hand.is_present else (1.0, 0.0)
        yield from _grasp(stage, hand, name, "pinch", side, None, HAND_SPEED)
    yield from steps
    if isinstance(event, Lift | Tilt):
        return
    if had:
        _keep(stage, hand, name)
    else:
        yield from _release(stage, hand)


def _dropped(event: Drop, stage: Stage, steps: Steps) -> Steps:
    """Whoever held it opens the fingers."""
    hands = [hand for hand in stage.hands.present if hand.held == event.object]
    yield from steps
    for hand in hands:
        yield from _release(stage, hand)


def _grasp(
    stage: Stage,
    hand: SimulatedHand,
    name: str,
    style: Style,
    side: tuple[float, float],
    above: float | None,
    speed: float,
) -> Steps:
    if hand.is_present and hand.held is not None:
        yield from _release(stage, hand)
    grip = take(stage.world, hand, name, style, side, above)
    tips = opened(stage.world, grip.pose, grip.closed, grip.opened)
    before = withdrawn(stage.world, grip.pose, tips, side)
    if not hand.is_present:
        _appear(hand, before, side)
    hand.from_side = side
    yield from _go(stage, hand, before, tips, speed)
    yield from _reach(hand, grip.pose, tips, min(speed, 0.2))
    yield from _close(hand, grip)
    hand.hold(name, stage.world.pose(name), style)
    if style == "pinch":
        _keep(stage, hand, name)


def _close(hand: SimulatedHand, grip: HandGrip) -> Steps:
    yield from _reach(hand, grip.pose, grip.closed, 1.0)


def _keep(stage: Stage, hand: SimulatedHand, name: str) -> None:
    """Hold an object in the hand, what is on or in it being free."""
    stage.take(name, contents=False)
    hand.held = name


def _release(stage: Stage, hand: SimulatedHand) -> Steps:
    """Open the fingers and draw back; what another hand holds as well stays in that."""
    if hand.held is not None and hand.style == "pinch" and not _is_held_by_another(stage, hand):
        stage.release(hand.held)
    hand.let_go()
    wide = hand.tips.copy()
    if hand.style == "pinch":
        wide[:2] += OPENED * _unit_rows(hand.tips[:2] - hand.tips[:2].mean(axis=0))
    yield from _reach(hand, hand.pose, opened(stage.world, hand.pose, hand.tips, wide), 1.0)
    yield from _reach(hand, withdrawn(stage.world, hand.pose, hand.tips, hand.from_side), hand.tips, 0.3)


def _is_held_by_another(stage: Stage, hand: SimulatedHand) -> bool:
    others = (other for other in stage.hands.present if other is not hand)
    return any(other.held == hand.held and other.style == "pinch" for other in others)


def _pushing(stage: Stage, hand: SimulatedHand, name: str, steps: Steps) -> Steps:
    """Let the hand go along with an object that it pushes, without turning."""
    start, pose = stage.world.pose(name).t, hand.pose
    hand.let_go()
    for _ in steps:
        x, y, _z = stage.world.pose(name).t
        hand.pose = Pose((pose.t[0] + x - start[0], pose.t[1] + y - start[1], pose.t[2]), pose.q)
        yield


def _go(stage: Stage, hand: SimulatedHand, goal: Pose, tips: Array, speed: float) -> Steps:
    """The same as `_reach`, past the things on the way or over them."""
    for pose, there in way(stage.world, (hand.pose, hand.tips), (goal, tips)):
        yield from _reach(hand, pose, there, speed)


def _reach(hand: SimulatedHand, goal: Pose, tips: Array, speed: float) -> Steps:
    """Palm to `goal` at `speed` m/s and fingertips (5, 3) to their places in it, evenly."""
    start, begun = hand.pose, hand.tips
    distance, angle = start.distance(goal)
    fingers = float(np.linalg.norm(tips - begun, axis=1).max())
    steps = max(1, math.ceil(max(distance / speed, angle / TURN_SPEED, fingers / FINGER_SPEED) / STEP))
    first, last = start.with_stamp(0.0), goal.with_stamp(1.0)
    for step in range(1, steps + 1):
        hand.pose = interpolate(first, last, step / steps)
        hand.tips = begun + (tips - begun) * (step / steps)
        yield


def _appear(hand: SimulatedHand, goal: Pose, side: tuple[float, float]) -> None:
    hand.from_side = side
    hand.pose, hand.tips = _away(goal, side), relaxed(hand.side)
    hand.is_present = True


def _away(pose: Pose, side: tuple[float, float]) -> Pose:
    length = math.hypot(*side) or 1.0
    x, y, z = pose.t
    return Pose((x + COMES_FROM * side[0] / length, y + COMES_FROM * side[1] / length, z + _RISEN), pose.q)


def _goal(pose: Pose, event: HandMove) -> Pose:
    x, y, z = pose.t
    by = event.by or (0.0, 0.0, 0.0)
    position: Vector3 = event.to if event.to is not None else (x + by[0], y + by[1], z + by[2])
    return Pose(position, turned(pose, event.turn))


def _present(stage: Stage, number: int) -> SimulatedHand:
    hand = stage.hands[number]
    if not hand.is_present:
        raise ConfigError(f"hand {number} is not in the scene; expected hand_enter or hand_grasp before")
    return hand


def _unit_rows(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))
