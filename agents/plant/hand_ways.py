"""Ways of a hand on which no fingertip goes through a body, as far as there are such."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from agents.plant.hand_figure import TIP_RADIUS
from agents.plant.world import World
from dsr.math3d.transforms import Pose, interpolate

Array = NDArray[np.float64]
Figure = tuple[Pose, Array]
"""A hand: its palm in the world, and its fingertips (5, 3) in that, m."""

BACK = 0.06
"""m, from which a hand closes in on an object, and by which it draws back from one"""
TOUCHING = 0.001
"""m, by which a fingertip may seem to be in a body that it touches: the slack of contact in the physics engine"""
_SHARES = (1.0, 0.5, 0.25)
"""Of how far fingers open, from what is tried first to what is left between things that are close together"""


def opened(world: World, pose: Pose, closed: Array, wide: Array) -> Array:
    """Fingertips (5, 3) of a hand that opens from `closed` to `wide`, as far as other bodies leave room."""
    tried = [closed + share * (wide - closed) for share in _SHARES]
    return min(tried, key=lambda tips: depth_on(world, [(pose, tips)]))


def withdrawn(world: World, pose: Pose, tips: Array, side: tuple[float, float]) -> Pose:
    """Where the palm of an open hand goes to leave an object, or comes from: to the `side` (world x, y), or upwards.

    It goes upwards if a fingertip would go through something else.
    """
    x, y, z = pose.t
    length = math.hypot(*side) or 1.0
    back = Pose((x + BACK * side[0] / length, y + BACK * side[1] / length, z), pose.q)
    return min((back, _raised(world, pose, tips)), key=lambda goal: depth_on(world, [(pose, tips), (goal, tips)]))


def way(world: World, start: Figure, goal: Figure) -> list[Figure]:
    """The way from one figure to the other, without the start: straight, or if that leads through things over them."""
    if depth_on(world, [start, goal]) == 0.0:
        return [goal]
    top = max(_raised(world, *start).t[2], _raised(world, *goal).t[2])
    over: list[Figure] = [(Pose((*pose.t[:2], top), pose.q), tips) for pose, tips in (start, goal)]
    return min([goal], [*over, goal], key=lambda figures: depth_on(world, [start, *figures]))


def depth_on(world: World, figures: list[Figure]) -> float:
    """m, by which a fingertip is in a body at most, as a hand goes from one figure to the next; 0 where it touches."""
    passed = [points for start, goal in pairwise(figures) for points in _between(start, goal)]
    points = np.concatenate([figures[0][0].apply(figures[0][1]), *passed])
    depth = max(world.depth((x, y, z), TIP_RADIUS) for x, y, z in points.tolist())
    return depth if depth > TOUCHING else 0.0


def _between(start: Figure, goal: Figure) -> list[Array]:
    """Fingertips in the world, (5, 3) each, so close together that none steps over a wall."""
    (first, tips), (last, last_tips) = start, goal
    metres = float(np.linalg.norm(last.apply(last_tips) - first.apply(tips), axis=1).max())
    count = max(1, math.ceil(metres / TIP_RADIUS))
    first, last = first.with_stamp(0.0), last.with_stamp(1.0)
    shares = [step / count for step in range(1, count + 1)]
    return [interpolate(first, last, share).apply(tips + (last_tips - tips) * share) for share in shares]


def _raised(world: World, pose: Pose, tips: Array) -> Pose:
    """The palm so high that all fingertips are above all objects."""
    lowest = float(pose.apply(tips)[:, 2].min()) - TIP_RADIUS
    x, y, z = pose.t
    return Pose((x, y, z + max(0.0, world.top + TIP_RADIUS - lowest)), pose.q)
