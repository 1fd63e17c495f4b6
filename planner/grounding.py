"""From steps of a plan to skills of the arm: which place on the table, which pose there."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.transforms import Array, Pose
from dsr.perception.scales import STANDING
from planner.arms import Place, chosen
from planner.config import PlannerConfig
from planner.errors import NoPlace
from planner.plan import PlanStep
from planner.state import KnownSolid, WorldState


@dataclass(frozen=True)
class Skill:
    """A request to the arm for one skill."""

    name: str
    """pick, place, look or observe"""
    target: str = ""
    destination: str = ""
    target_pose: Pose | None = None
    """world_from_object wanted, for a place on the table."""
    arm: str = ""
    """Name of the arm that does it; empty for the only one."""

    def __str__(self) -> str:
        where = f"on {self.destination}" if self.destination else ""
        return " ".join(part for part in (self.name, self.target, where) if part)


OBSERVE = Skill("observe")


def ground(
    steps: tuple[PlanStep, ...], state: WorldState, config: PlannerConfig, avoid: Collection[Place] = ()
) -> list[Skill]:
    """The skills for `steps`, one each, with a place for whatever is put on the table.

    Of several arms each thing is moved by the nearest that reaches it and where it goes. `avoid` are places that have
    proved bad. Equal arguments give equal results. Raises `NoPlace`, also where no arm reaches.
    """
    skills = []
    doer = _holder(state)
    for step, following in zip_longest(steps, steps[1:]):
        if step.name == "pick":
            doer = _doer(step, following, state, config)
            skills.append(Skill("pick", step.thing, arm=doer))
            continue
        pose = place_on_table(step.thing, state, config, avoid, doer) if step.name == "putdown" else None
        skills.append(Skill("place", step.thing, step.support, pose, doer))
        state = _moved(state, step, pose)
    return skills


def _holder(state: WorldState) -> str:
    """The arm that holds something at the start; empty for the only one."""
    grippers = {gripper for gripper, _ in state.relations.grasping}
    holders = [arm.name for arm in state.arms.values() if arm.gripper in grippers]
    return holders[0] if holders and state.is_shared else ""


def _doer(pick: PlanStep, following: PlanStep | None, state: WorldState, config: PlannerConfig) -> str:
    """The arm that picks a thing up and does with it what follows; empty for the only one. Raises `NoPlace`."""
    names = [pick.thing]
    if following is not None and following.name == "stack" and following.thing == pick.thing:
        names.append(following.support)
    places = [(x, y) for name in names if name in state.solids for x, y, _ in [state.solids[name].pose.t]]
    if not state.is_shared:
        return ""
    arm = chosen(state.arms.values(), places, config)
    if arm is None:
        why = "".join(f"; {trouble}" for trouble in state.trouble)
        raise NoPlace(f"no arm that works reaches {' and '.join(names)}{why}")
    return arm.name


def _moved(state: WorldState, step: PlanStep, pose: Pose | None) -> WorldState:
    """The state with the thing where the step puts it: at `pose`, or on its support."""
    pose = pose or stacked(step.thing, step.support, state)
    if pose is None:
        return state
    solids = {**state.solids, step.thing: KnownSolid(state.solids[step.thing].size, pose)}
    doubts = {name: doubts for name, doubts in state.doubts.items() if name != step.thing}
    return replace(state, solids=solids, doubts=doubts)


def place_on_table(
    thing: str, state: WorldState, config: PlannerConfig, avoid: Collection[Place] = (), arm: str = ""
) -> Pose:
    """world_from_thing standing on the table: free, within reach of the arm, in view of every fixed camera.

    A place counts as free if it is with a probability of `config.sure` at least, by where all things may be. Without
    any such place, those count where that is most probable. It is the nearest of them to where the thing is now. Raises
    `NoPlace` with what is in the way.
    """
    solid = state.solids.get(thing)
    table = state.solids.get(state.table or "")
    if solid is None or table is None:
        raise NoPlace(f"{thing} cannot be put down: {'its size or pose' if table else 'a table'} is not known")
    places = grid(table, solid.radius + config.least_clearance, config.least_clearance)
    places = places[_usable(places, solid, state, config, avoid, arm)]
    free = _free(places, thing, solid, state, config)
    if not len(free):
        raise NoPlace(f"there is no room on {state.table} for {thing}: everything within reach is taken or out of view")
    far = np.round(np.hypot(*(free - solid.pose.t[:2]).T), 6)  # so that rounding errors decide nothing
    x, y = free[np.lexsort((np.round(free[:, 1], 6), np.round(free[:, 0], 6), far))[0]].tolist()
    return Pose((x, y, table.pose.t[2] + 0.5 * solid.size[2]), _turn(solid.pose))


def _free(places: Array, thing: str, solid: KnownSolid, state: WorldState, config: PlannerConfig) -> Array:
    """(n, 2) those of the places that have room around them, as much as any has."""
    gaps = _gaps(places, thing, solid, state)
    sizes = [room for room in (config.clearance, config.least_clearance) if (gaps >= room).any()]
    chances = [np.where(gaps >= room, _chances(places, thing, solid, state, room), -1.0) for room in sizes]
    for chance in chances:
        if (chance >= config.sure).any():
            return np.asarray(places[chance >= config.sure])
    best = np.round(chances[0], 6) if chances else np.zeros(0)
    return np.asarray(places[best == best.max()] if chances else places[:0])


def is_free(
    pose: Pose, thing: str, state: WorldState, config: PlannerConfig, avoid: Collection[Place] = (), arm: str = ""
) -> bool:
    """Check that a place that was chosen earlier is still good: within reach, in view of the fixed cameras, and with
    enough room around it.
    """
    place = np.array([pose.t[:2]])
    solid = state.solids.get(thing)
    if solid is None or not _usable(place, solid, state, config, avoid, arm)[0]:
        return False
    room = config.least_clearance
    is_likely = _chances(place, thing, solid, state, room)[0] >= config.sure
    return bool(is_likely and _gaps(place, thing, solid, state)[0] >= room)


def stacked(thing: str, support: str, state: WorldState) -> Pose | None:
    """world_from_thing resting in the middle of `support`, turned like it; None if their sizes are not known."""
    solid, below = state.solids.get(thing), state.solids.get(support)
    if solid is None or below is None:
        return None
    x, y, z = below.pose.t
    return Pose((x, y, z + 0.5 * (below.size[2] + solid.size[2])), _turn(below.pose))


def grid(table: KnownSolid, margin: float, step: float) -> Array:
    """(n, 2) places on the table's top, x and y in the world (m), `step` apart, at least `margin` inside its edges."""
    counts = [int((0.5 * edge - margin) / step) for edge in table.size[:2]]
    steps = [np.arange(-count, count + 1) * step for count in counts]
    x, y = (axis.ravel() for axis in np.meshgrid(*steps, indexing="ij"))
    places: Array = table.pose.apply(np.stack([x, y, np.zeros_like(x)], axis=1))[:, :2]
    return places


def _usable(
    places: Array, solid: KnownSolid, state: WorldState, config: PlannerConfig, avoid: Collection[Place], arm: str
) -> NDArray[np.bool_]:
    """(n,) which of the places (n, 2) are within reach, in view of all fixed cameras, and not to be avoided."""
    usable = within_reach(places, state, config, arm)
    for bad in avoid:
        usable &= np.hypot(*(places - bad).T) >= config.least_clearance
    table = state.solids.get(state.table or "")
    top = solid.size[2] + (table.pose.t[2] if table else 0.0)
    points = np.column_stack([places, np.full(len(places), top)])
    for view in state.views:
        usable &= view.sees(points, solid.radius)
    return usable


def within_reach(places: Array, state: WorldState, config: PlannerConfig, arm: str = "") -> NDArray[np.bool_]:
    """(n,) which of the places (n, 2) are within reach of the arm; of any arm for an empty name."""
    within = np.zeros(len(places), dtype=bool)
    for one in [state.arms[arm]] if arm in state.arms else state.arms.values():
        reach = np.hypot(*(places - one.base).T)
        within |= (config.least_reach <= reach) & (reach <= config.most_reach)
    return within


def _gaps(places: Array, thing: str, solid: KnownSolid, state: WorldState) -> Array:
    """(n,) m between a thing at each of the places (n, 2) and the nearest other one; their footprints are circles."""
    others = [other for name, other in state.solids.items() if name != thing and name not in state.relations.tables]
    if not others:
        return np.full(len(places), np.inf)
    centres = np.array([other.pose.t[:2] for other in others])
    radii = np.array([solid.radius + other.radius for other in others])
    between = places[:, None, :] - centres
    gaps: Array = (np.hypot(between[..., 0], between[..., 1]) - radii).min(axis=1)
    return gaps


def _chances(places: Array, thing: str, solid: KnownSolid, state: WorldState, room: float) -> Array:
    """(n,) probability that nothing which may be elsewhere than it is believed to be is within `room` m of a thing.

    Args:
        places: (n, 2) m, where the thing would be.
        thing: its name.
        solid: its size.
        state: tells where other things may be.
        room: m.
    """
    chances = np.ones(len(places))
    for name, doubts in state.doubts.items():
        if name != thing:
            centres = np.array([doubt.place for doubt in doubts])
            gaps = np.hypot(*(places[:, None] - centres).transpose(2, 0, 1)) - solid.radius - state.solids[name].radius
            chances *= 1.0 - (gaps < room) @ np.array([doubt.probability for doubt in doubts])
    return chances


def _turn(pose: Pose) -> tuple[float, float, float, float]:
    """The rotation of `pose` about the vertical, if it stands upright; else none."""
    tilt = math.acos(max(-1.0, min(1.0, quaternions.rotate(pose.q, (0.0, 0.0, 1.0))[2])))
    if tilt > STANDING:
        return (0.0, 0.0, 0.0, 1.0)
    x, y, _ = quaternions.rotate(pose.q, (1.0, 0.0, 0.0))
    half = 0.5 * math.atan2(y, x)
    return (0.0, 0.0, math.sin(half), math.cos(half))
