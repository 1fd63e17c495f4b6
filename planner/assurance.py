"""Makes sure, before the arm relies on where things are, that they are probably there: looks, or lifts a cover."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from dsr.believing.distribution import Alternative, Whereabouts
from dsr.math3d.quaternions import Vector3, conjugate, product, rotate
from dsr.memory import Memory
from dsr.timeline import Chronicle
from dsr.vocabulary.intentions import DONE
from dsr.vocabulary.sentences import listed, percent
from planner.arm import Arm
from planner.arms import chosen
from planner.config import PlannerConfig
from planner.covers import Covers
from planner.errors import NoPlace, Outdated
from planner.grounding import Skill, place_on_table
from planner.looking import Search
from planner.outlook import Look, Outlooks, can_be_lifted
from planner.plan import PlanStep
from planner.state import KnownSolid, WorldState, read_state

LOOKED = "looked"
"""Kind of the event of a look that comes before an action, or of a cover that is lifted, with the reason"""


class _Room(NamedTuple):
    """How far a thing may be off, for an action to succeed."""

    shift: Vector3
    """m to both sides along each axis of the thing"""
    turn: float = math.inf
    """rad to both sides about its upright axis"""


class Assurance:
    """Looks before actions whose success is not probable enough.

    Args:
        memory: the graph, with the belief's distributions.
        arm: carries the camera, and lifts covers.
        looking: brings the camera somewhere.
        config: how sure is sure enough.
        kept: names of the things that other goals want where they are.
        log: says why there is a look, or none.
    """

    def __init__(
        self, memory: Memory, arm: Arm, looking: Search, config: PlannerConfig, kept: Callable[[], Collection[str]],
        log: logging.Logger,
    ) -> None:  # fmt: skip
        self._memory, self._arm, self._looking = memory, arm, looking
        self._config, self._kept, self._log = config, kept, log
        self._done: dict[str, list[Look]] = {}
        """What was done for each thing, by name: the same look a second time tells nothing"""
        self._chronicle = Chronicle(memory)

    def make_sure(self, step: PlanStep, following: PlanStep | None) -> Generator[None, None, bool]:
        """Look until a pick, and the stacking that follows it, will probably succeed, or no look tells more.

        Returns:
            Whether there was a look.

        Raises:
            Outdated: if a cover was lifted, so that another plan may be wanted.
        """
        done = self._done.setdefault(step.thing, [])
        looks = len(done)
        while step.name == "pick" and self._chance(step, following) < self._config.sure:
            look = self._uncovering(step, following, done) or (yield from self._best_look(step, following, done))
            if look is None:
                break
            if self._chance(step, following) >= self._config.sure:
                continue  # something was seen meanwhile
            done.append(look)
            told = self._tell(look, step, following)
            if look.view is None or look.eye is None:
                problem = yield from self._lift(look.cover, told)
                if not problem:
                    raise Outdated(told)
                self._log.warning("%s cannot be lifted: %s", look.cover, problem)
                continue
            yield from self._looking.look_from(
                look.view, look.eye, lambda: self._chance(step, following) < self._config.sure, told
            )
        return len(done) > looks

    def _best_look(
        self, step: PlanStep, following: PlanStep | None, done: Sequence[Look]
    ) -> Generator[None, None, Look | None]:
        """The look that tells most, chosen over some ticks; None if none is worth it, which is logged."""
        eyes = self._looking.eyes()
        problem = self._looking.problem
        things = self._doubtful(step, following)
        state = read_state(self._memory, self._config)
        look = yield from Outlooks(self._memory, state, eyes, things, self._config).best(done, self._kept())
        if look is None:
            sure = percent(self._chance(step, following))
            self._log.info("going on, though %s will succeed with %s: %s", step, sure, problem or "no look tells more")
        return look

    def _uncovering(self, step: PlanStep, following: PlanStep | None, done: Sequence[Look]) -> Look | None:
        """A cover to be lifted because success is probable enough without it: what is under it cannot be taken."""
        state, covering = read_state(self._memory, self._config), Covers(self._memory, self._config)
        wheres = self._wheres(step, following, state)
        covers = {covering.cover_of(name, one) for name, (where, _) in wheres.items() for one in where.alternatives}
        spared = {"", *self._kept(), *(look.cover for look in done)}
        for cover in sorted(covers - spared):
            if not can_be_lifted(cover, state, self._config):
                continue
            chances = self._chances(step, following, partial(covering.reaches, without=cover))
            if math.prod(chances.values()) >= self._config.sure:
                return Look(0.0, cover=cover)
        return None

    def _tell(self, look: Look, step: PlanStep, following: PlanStep | None) -> str:
        """Write into the timeline why there is a look; returns the text."""
        things = self._doubtful(step, following)
        if look.information > 0.0:
            there = self._chances(step, following, lambda _name, _one: True)
            doubt = listed([f"{name} is where it is believed to be with {percent(there[name])}" for name in things])
            why = f"{doubt}; {look.information:.2f} nats are expected"
        else:
            why = f"{listed(things)} cannot be reached under it"
        text = f"{look} before {step}: {why}"
        self._chronicle.happened(LOOKED, things, text=text, confidence=self._chance(step, following))
        self._log.info("%s", text)
        return text

    def _doubtful(self, step: PlanStep, following: PlanStep | None) -> list[str]:
        """Names of the things that the arm relies on too little: all of them together must be sure enough."""
        chances = self._chances(step, following)
        each = self._config.sure ** (1.0 / max(len(chances), 1))
        return sorted(name for name, chance in chances.items() if chance < each)

    def _chance(self, step: PlanStep, following: PlanStep | None) -> float:
        return math.prod(self._chances(step, following).values())

    def _chances(
        self, step: PlanStep, following: PlanStep | None, is_reached: Callable[[str, Alternative], bool] | None = None
    ) -> Mapping[str, float]:
        """Probability of each thing that the arm relies on to be where it has to be for that.

        Only alternatives count in which the arm reaches the thing of a name; by default, where it is under no cover.
        """
        state = read_state(self._memory, self._config)
        is_reached = is_reached or Covers(self._memory, self._config).reaches
        return {
            name: chance_within(where, state.solids[name], room.shift, partial(is_reached, name), room.turn)
            for name, (where, room) in self._wheres(step, following, state).items()
        }

    def _wheres(
        self, step: PlanStep, following: PlanStep | None, state: WorldState
    ) -> Mapping[str, tuple[Whereabouts, _Room]]:
        """Where each thing may be that the arm relies on, and how far it may be off."""
        rooms = {}
        if (solid := state.solids.get(step.thing)) is not None:
            turn = turn_between_fingers(solid, self._config) if self._is_box(step.thing) else math.inf
            rooms[step.thing] = _Room(room_between_fingers(solid, self._config), turn)
        stacks = following is not None and following.name == "stack" and following.thing == step.thing
        if stacks and following is not None and following.support in state.solids:
            x, y, z = state.solids[following.support].size
            rooms[following.support] = _Room((0.5 * x, 0.5 * y, 0.5 * z))
        wheres = {name: self._memory.belief(name) for name in rooms if name in self._memory}
        return {name: (where, rooms[name]) for name, where in wheres.items() if where is not None}

    def _is_box(self, name: str) -> bool:
        """Whether a thing has no other shape: what is round is as wide from all sides, and others have rims."""
        node = self._memory.get_node(name)
        return node is not None and node.get("shape") is None

    def _lift(self, cover: str, told: str) -> Generator[None, None, str]:
        """Take a cover off and put it on the table; returns why that did not succeed, empty if it did."""
        state = read_state(self._memory, self._config)
        try:
            arm = _lifting_arm(cover, state, self._config)
            place = place_on_table(cover, state, self._config, arm=arm)
        except NoPlace as error:
            return str(error)
        for skill in (Skill("pick", cover, arm=arm), Skill("place", cover, state.table or "", place, arm)):
            progress = yield from self._arm.run_apart(skill, told)
            if progress.status != DONE:
                return progress.explanation or progress.status
        return ""


def _lifting_arm(cover: str, state: WorldState, config: PlannerConfig) -> str:
    """The nearest arm that reaches a cover; empty for the only one. Raises `NoPlace`."""
    if not state.is_shared:
        return ""
    places = [(x, y) for solid in (state.solids.get(cover),) if solid is not None for x, y, _ in (solid.pose.t,)]
    arm = chosen(state.arms.values(), places, config) if places else None
    if arm is None:
        raise NoPlace(f"no arm that works reaches {cover}")
    return arm.name


def room_between_fingers(solid: KnownSolid, config: PlannerConfig) -> Vector3:
    """M along its axes that a thing may be off where it is, and still be grasped from above.

    The fingers close along the narrower of its two level sides. There it is the free part of the opening; along the
    others the fingers still meet the thing.
    """
    narrow, _ = _level_axes(solid)
    room = [0.5 * edge for edge in solid.size]
    room[narrow] = 0.5 * max(0.0, config.widest_grip - solid.size[narrow])
    return room[0], room[1], room[2]


def turn_between_fingers(solid: KnownSolid, config: PlannerConfig) -> float:
    """Radians about its upright axis that a box may be turned, and still be grasped from above; infinite for any.

    Turned by more, it is wider between the fingers than they open.
    """
    across, lengthwise = (solid.size[axis] for axis in _level_axes(solid))
    diagonal = math.hypot(across, lengthwise)
    if diagonal <= config.widest_grip:
        return math.inf
    return max(0.0, math.asin(config.widest_grip / diagonal) - math.atan2(across, lengthwise))


def chance_within(
    where: Whereabouts,
    solid: KnownSolid,
    room: Vector3,
    is_reached: Callable[[Alternative], bool] = lambda _: True,
    turn: float = math.inf,
) -> float:
    """Probability that a thing is off by less than `room` from where it is believed to be, and in nobody's hand.

    Args:
        where: its distribution.
        solid: where it is believed to be.
        room: m to both sides along each axis of the thing.
        is_reached: whether the arm can reach it in an alternative.
        turn: rad to both sides about its upright axis.
    """
    return sum(one.weight * _within(one, solid, room, turn) for one in where.alternatives if is_reached(one))


def _within(one: Alternative, solid: KnownSolid, room: Vector3, most: float) -> float:
    if one.pose is None or one.hand:
        return 0.0
    back = conjugate(solid.pose.q)
    x, y, z = (mine - believed for mine, believed in zip(one.pose.t, solid.pose.t, strict=True))
    off = rotate(back, (x, y, z))
    variances = np.zeros((2, len(off)))
    if one.pose.covariance is not None:
        variances = np.diag(one.pose.covariance).reshape(variances.shape)
    deviations, turning = np.sqrt(np.maximum(variances, 0.0)).tolist()
    there = math.prod(map(_normal_within, off, deviations, room))
    if math.isinf(most):
        return there
    axis, turned = _upright_axis(solid), product(back, one.pose.q)
    turn = 2.0 * math.atan2(turned[axis], turned[3])
    halves = (turn + math.pi * half for half in range(-2, 3))  # after half a turn a box is between the fingers again
    return there * min(1.0, sum(_normal_within(mean, turning[axis], most) for mean in halves))


def _upright_axis(solid: KnownSolid) -> int:
    """Which of its axes is nearest to the vertical."""
    return int(np.abs(solid.pose.rotation_matrix[2]).argmax())


def _level_axes(solid: KnownSolid) -> list[int]:
    """The other two, the shorter one first."""
    upright = _upright_axis(solid)
    return sorted((axis for axis in range(len(solid.size)) if axis != upright), key=lambda axis: solid.size[axis])


def _normal_within(mean: float, deviation: float, room: float) -> float:
    """Probability that a normal variable is within `room` of zero."""
    if deviation <= 0.0:
        return float(abs(mean) <= room)
    scale = deviation * math.sqrt(2.0)
    return 0.5 * (math.erf((room - mean) / scale) - math.erf((-room - mean) / scale))
