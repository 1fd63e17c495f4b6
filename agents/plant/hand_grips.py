"""How a hand takes an object: where the palm is and where the fingertips touch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.plant.hand_figure import TIP_RADIUS, palm_pose, relaxed
from agents.plant.hands import SimulatedHand, Style
from agents.plant.world import World
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

REACH = {"pinch": 0.078, "touch": 0.112}
"""m, from the palm's centre along its axis to the middle between the fingertips: a thumb reaches no further"""
ASIDE = {"pinch": 0.072, "touch": 0.0185}
"""m, of that middle towards the thumb from the palm's axis: fingers go straight ahead and hide little"""
TURNED = {"pinch": 0.8, "touch": 0.0}
"""rad, by which the palm is turned away from the thumb's side: thumb and index finger are of different lengths"""
PITCH = 0.6
"""rad, angle below the horizontal of the fingers of a hand that takes something"""
OPENED = 0.025
"""m, distance of each fingertip from the object before it closes"""
UPPER = 0.2
"""Share of an object's height, by which it is taken above its centre."""
SPREAD = 0.022
"""m, between fingertips side by side"""
MOST_SPREAD = 0.08
"""m, by which fingers that do not touch are sideways of where they are at rest"""
RAISED = 0.02
"""m, distance out of the palm's plane of fingers that do not touch"""
_MOST_HITS = 6
_MOST_RAISED = 4  # times that, at which a finger is straight up


class HandGrip(NamedTuple):
    """A hand at an object."""

    pose: Pose
    """Pose of the palm in the world, world_from_palm"""
    closed: Array
    """(5, 3) fingertips in the palm's frame that touch it"""
    opened: Array
    """(5, 3) the same shortly before"""


def pinch(world: World, hand: SimulatedHand, name: str, side: tuple[float, float], above: float | None) -> HandGrip:
    """Thumb and index finger on opposite sides, the hand coming from `side` (world x, y).

    `above` is the height of the fingertips over the object's centre, m.
    """
    towards = _unit(np.array([*side, 0.0]))
    across = np.array([towards[1], -towards[0], 0.0]) * (-1.0 if hand.side == "left" else 1.0)
    centre = _contact_height(world, name, above)
    thumb = _laid_on(world, name, centre, across)
    index = _laid_on(world, name, centre, -across)
    moved = {0: (thumb, across), 1: (index, -across)}
    return _grip(world, hand, "pinch", 0.5 * (thumb + index), side, moved)


def touch(world: World, hand: SimulatedHand, name: str, side: tuple[float, float], above: float | None) -> HandGrip:
    """Index and middle fingertips laid on the side of the object that the hand comes from."""
    towards = _unit(np.array([*side, 0.0]))
    across = np.array([towards[1], -towards[0], 0.0]) * (-1.0 if hand.side == "left" else 1.0)
    centre = _contact_height(world, name, above)
    moved = {}
    for finger, offset in ((1, 0.5 * SPREAD), (2, -0.5 * SPREAD)):
        moved[finger] = (_laid_on(world, name, centre + offset * across, towards), towards)
    return _grip(world, hand, "touch", 0.5 * (moved[1][0] + moved[2][0]), side, moved)


def take(
    world: World, hand: SimulatedHand, name: str, style: Style, side: tuple[float, float], above: float | None
) -> HandGrip:
    """Compute how a hand takes an object in the style `style`."""
    return (pinch if style == "pinch" else touch)(world, hand, name, side, above)


def _laid_on(world: World, name: str, centre: Array, outwards: Array) -> Array:
    """(3,) the centre of a fingertip that touches an object from outside, on the ray from `centre` outwards."""
    tip = surface(world, name, centre, outwards) + TIP_RADIUS * outwards
    for _ in range(_MOST_HITS):  # where the surface is askew, a ball is still in it
        tip = tip + world.depth(_vector(tip), TIP_RADIUS, name) * outwards
    return np.asarray(tip)


def surface(world: World, name: str, centre: Array, outwards: Array) -> Array:
    """(3,) the outermost point of an object on the ray from `centre` (world, m) along the unit vector `outwards`.

    Where the ray misses it: on the object's bounding box.
    """
    size = np.array(world.specs[name].size)
    far = centre + outwards * (float(np.linalg.norm(size)) + 0.01)
    body = world.body(name)
    start = far
    for _ in range(_MOST_HITS):
        hit = world.bullet.rayTest(start.tolist(), centre.tolist())[0]
        if hit[0] == body:
            return np.array(hit[3])
        if hit[0] < 0:
            break
        start = np.array(hit[3]) - 1e-4 * outwards
    direction = np.abs(world.pose(name).rotation_matrix.T @ outwards)
    with np.errstate(divide="ignore"):
        return np.asarray(centre + outwards * float((size / 2 / direction).min()))


def _contact_height(world: World, name: str, above: float | None) -> Array:
    """(3,) the point within the object around which the fingertips are."""
    pose, spec = world.pose(name), world.specs[name]
    if above is None:
        kind: str = spec.type
        above = 0.0 if kind == "ball" else UPPER * spec.size[2]
    return np.asarray(pose.translation + np.array([0.0, 0.0, above]))


def _grip(
    world: World,
    hand: SimulatedHand,
    style: Style,
    middle: Array,
    side: tuple[float, float],
    moved: dict[int, tuple[Array, Array]],
) -> HandGrip:
    """The palm `REACH` from `middle`; `moved` gives place and outward direction (world) of fingertips that touch."""
    mirror = -1.0 if hand.side == "left" else 1.0
    turn = -mirror * TURNED[style]
    back = _unit(np.array([*side, 0.0])) @ [
        [math.cos(turn), math.sin(turn), 0.0], [-math.sin(turn), math.cos(turn), 0.0], [0.0, 0.0, 1.0]
    ]  # fmt: skip
    across = mirror * np.array([back[1], -back[0], 0.0])
    slope = math.cos(PITCH) * back + math.sin(PITCH) * np.array([0.0, 0.0, 1.0])
    palm = middle + REACH[style] * slope - ASIDE[style] * across
    pose = palm_pose((float(palm[0]), float(palm[1]), float(palm[2])), (float(back[0]), float(back[1])), PITCH)
    palm_from_world = pose.inverse()
    closed = relaxed(hand.side)
    for finger, (tip, _) in moved.items():
        closed[finger] = palm_from_world.apply(tip)
    _spread(closed, max(moved), mirror)
    _raise(world, pose, closed, max(moved))
    opened = closed.copy()
    for finger, (tip, outwards) in moved.items():
        opened[finger] = palm_from_world.apply(tip + OPENED * outwards)
    return HandGrip(pose, closed, opened)


def _spread(tips: Array, last: int, mirror: float) -> None:
    """Put the fingers after the last one that touches beside it, a bit higher, so that they are not in the object."""
    for finger in range(last + 1, len(tips)):
        beside = mirror * tips[last, 1] - SPREAD * (finger - last) - SPREAD
        tips[finger, 2] += RAISED
        tips[finger, 1] = mirror * max(beside, mirror * tips[finger, 1] - MOST_SPREAD)


def _raise(world: World, pose: Pose, tips: Array, last: int) -> None:
    """Lift fingers after the last one that touches out of what they would be in, as far as they can be lifted."""
    for finger in range(last + 1, len(tips)):
        lifts = [tips[finger] + (0.0, 0.0, times * RAISED) for times in range(_MOST_RAISED)]
        depths = [world.depth(_vector(pose.apply(tip)), TIP_RADIUS) for tip in lifts]
        tips[finger] = lifts[depths.index(min(depths))]


def _vector(point: Array) -> Vector3:
    x, y, z = point.tolist()
    return x, y, z


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))
