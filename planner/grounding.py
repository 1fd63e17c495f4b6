"""From steps of a plan to skills of the arm: which place on the table, which pose there."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from dsr import quaternions
from dsr.transforms import Pose
from planner.config import PlannerConfig
from planner.errors import NoPlace
from planner.plan import Step
from planner.state import Solid, WorldState

_GRID = 0.02
"""m between places that are considered"""
_UPRIGHT = 0.2
"""rad that a thing may lean and still keep its turn about the vertical when it is put down"""

Place = tuple[float, float]
"""x, y in the world, m."""


@dataclass(frozen=True)
class Skill:
    """What is asked of the arm."""

    name: str
    """pick, place or observe"""
    target: str = ""
    destination: str = ""
    target_pose: Pose | None = None
    """world_from_object wanted, for a place on the table."""

    def __str__(self) -> str:
        where = f"on {self.destination}" if self.destination else ""
        return " ".join(part for part in (self.name, self.target, where) if part)


OBSERVE = Skill("observe")


def ground(
    steps: tuple[Step, ...], state: WorldState, config: PlannerConfig, avoid: Collection[Place] = ()
) -> list[Skill]:
    """The skills for `steps`, one each, with a place for whatever is put on the table.

    `avoid` are places that have proved bad. Equal arguments give equal results. Raises `NoPlace`.
    """
    skills = []
    for step in steps:
        if step.name == "pick":
            skills.append(Skill("pick", step.thing))
            continue
        pose = place_on_table(step.thing, state, config, avoid) if step.name == "putdown" else None
        skills.append(Skill("place", step.thing, step.support, pose))
        state = _moved(state, step, pose)
    return skills


def _moved(state: WorldState, step: Step, pose: Pose | None) -> WorldState:
    """The state with the thing where the step puts it: at `pose`, or on its support."""
    pose = pose or stacked(step.thing, step.support, state)
    if pose is None:
        return state
    return replace(state, solids={**state.solids, step.thing: Solid(state.solids[step.thing].size, pose)})


def place_on_table(thing: str, state: WorldState, config: PlannerConfig, avoid: Collection[Place] = ()) -> Pose:
    """world_from_thing standing on the table: free, within reach, in view of every fixed camera.

    Among those places the nearest to where it is now. Raises `NoPlace` with what is in the way.
    """
    solid = state.solids.get(thing)
    table = state.solids.get(state.table or "")
    if solid is None or table is None:
        raise NoPlace(f"{thing} cannot be put down: {'its size or pose' if table else 'a table'} is not known")
    near, turn = (solid.pose.t[0], solid.pose.t[1]), _turn(solid.pose)
    options = sorted(_places(table, solid.radius + config.edge_margin), key=lambda place: _preference(place, near))
    for place in options:
        if _is_good(place, thing, solid, state, config, avoid):
            return Pose((*place, table.pose.t[2] + 0.5 * solid.size[2]), turn)
    raise NoPlace(f"there is no room on {state.table} for {thing}: everything within reach is taken or out of view")


def is_free(pose: Pose, thing: str, state: WorldState, config: PlannerConfig, avoid: Collection[Place] = ()) -> bool:
    """Whether a place that was chosen earlier is still good."""
    place = (pose.t[0], pose.t[1])
    return thing in state.solids and _is_good(place, thing, state.solids[thing], state, config, avoid)


def stacked(thing: str, support: str, state: WorldState) -> Pose | None:
    """world_from_thing resting in the middle of `support`, turned like it; None if their sizes are not known."""
    solid, below = state.solids.get(thing), state.solids.get(support)
    if solid is None or below is None:
        return None
    x, y, z = below.pose.t
    return Pose((x, y, z + 0.5 * (below.size[2] + solid.size[2])), _turn(below.pose))


def _is_good(
    place: Place, thing: str, solid: Solid, state: WorldState, config: PlannerConfig, avoid: Collection[Place]
) -> bool:
    reach = math.dist(place, state.base)
    if not config.least_reach <= reach <= config.most_reach:
        return False
    if any(math.dist(place, other) < _GRID for other in avoid):
        return False
    for name, other in state.solids.items():
        if name != thing and name not in state.relations.tables:
            gap = math.dist(place, other.pose.t[:2]) - solid.radius - other.radius
            if gap < config.clearance:
                return False
    top = (*place, state.solids[state.table or ""].pose.t[2] + solid.size[2])
    return all(view.sees(top, config.image_margin) for view in state.views)


def _places(table: Solid, margin: float) -> Iterator[Place]:
    """A grid over the table's top (x, y in the world), at least `margin` inside its edges."""
    for x in _steps(0.5 * table.size[0] - margin):
        for y in _steps(0.5 * table.size[1] - margin):
            point = table.pose.apply((x, y, 0.0))
            yield float(point[0]), float(point[1])


def _steps(most: float) -> list[float]:
    count = max(int(most / _GRID + 1e-9), -1)
    return [number * _GRID for number in range(-count, count + 1)]


def _preference(place: Place, near: Place) -> tuple[float, float, float]:
    """Order: by distance, rounded so that rounding errors decide nothing, then by coordinates."""
    return round(math.dist(place, near), 6), round(place[0], 6), round(place[1], 6)


def _turn(pose: Pose) -> tuple[float, float, float, float]:
    """The rotation of `pose` about the vertical, if it stands upright; else none."""
    tilt = math.acos(max(-1.0, min(1.0, quaternions.rotate(pose.q, (0.0, 0.0, 1.0))[2])))
    if tilt > _UPRIGHT:
        return (0.0, 0.0, 0.0, 1.0)
    x, y, _ = quaternions.rotate(pose.q, (1.0, 0.0, 0.0))
    half = 0.5 * math.atan2(y, x)
    return (0.0, 0.0, math.sin(half), math.cos(half))
