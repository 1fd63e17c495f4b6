"""Answers what-if questions (dsr/vocabulary/what_if.py) by simulating copies of the believed scene, one a world.

Where something moves, the world is simulated without the changes, too: what moves anyway is no effect of them.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Collection, Sequence

import msgspec

from dsr.clock import Clock
from dsr.errors import DsrError, SchemaError, suggest
from dsr.math3d.polygons import overlap
from dsr.math3d.quaternions import conjugate, product
from dsr.math3d.shapes import from_numbers
from dsr.math3d.transforms import Pose
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.perception.reach import FARTHEST
from dsr.perception.scales import RESOLUTION, SAME_OUTCOME
from dsr.vocabulary.what_if import (
    LONGEST,
    SERVICE,
    Answer,
    Numbers,
    Question,
    Supposed,
    WorldOutcome,
    decode_question,
    encode_answer,
)
from simulation_handler.contact.relations import STEEP
from simulation_handler.graph_io.reading import MASSES
from simulation_handler.physics.rollouts.engine import Engine, LateError, RolloutOutcome
from simulation_handler.physics.rollouts.scene import Placing, RolloutBody, RolloutScene
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR
from simulation_handler.worlds.joint import ONE_OUTCOME, JointWorld, leading
from simulation_handler.worlds.model import Island

KEY = f"service/{SERVICE}"
"""Key of the service below the graph's root: a secured graph must grant it."""
_MOST_QUESTIONS = 16  # count of questions that wait; further ones are refused

_log = logging.getLogger("simulation_handler.graph_io.what_if")


IsLate = Callable[[], bool]
"""Tells whether nobody waits for an answer any more."""


class RefusedError(DsrError):
    """A question that has no answer; says why."""


class WhatIfService:
    """Serves a graph; knows the scene that was offered last, and never touches the belief.

    Whatever comes in, the caller gets an answer, if only a refusal. Questions are simulated one at a time; beyond
    16 that wait, or when the asker has stopped waiting, they are refused, which costs nothing. A question that takes
    longer than its asker waits, or than `LONGEST`, is given up: it would hold up all others.
    """

    def __init__(self, bus: Transport, keys: Keys, clock: Clock) -> None:
        self._clock = clock
        self._offered: tuple[RolloutScene, Sequence[Island], float] | None = None
        self._engine: Engine | None = None
        self._closed = False
        self._one_at_a_time = threading.Lock()
        self._seats = threading.BoundedSemaphore(_MOST_QUESTIONS)
        self._subscription = bus.serve(keys.service(SERVICE), lambda _, payload: encode_answer(self.answer(payload)))

    def offer(self, scene: RolloutScene, islands: Sequence[Island], now: float) -> None:
        """Answer from this scene, and what may be otherwise in it by `islands`, as it is at `now` (s), from now on."""
        self._offered = (scene, islands, now)

    def close(self) -> None:
        """Answer no more and free the simulation; harmless when repeated."""
        self._subscription.close()
        with self._one_at_a_time:
            self._closed = True
            if self._engine is not None:
                self._engine.close()

    def answer(self, payload: bytes) -> Answer:
        """Answer a message, from any thread; never raises."""
        try:
            return self._answer(decode_question(payload))
        except DsrError as error:
            return _tried_nowhere(str(error))
        except Exception as error:
            _log.exception("a what-if question could not be answered")
            return _tried_nowhere(f"the simulation handler failed: {error!r}")

    def _answer(self, question: Question) -> Answer:
        gives_up = self._clock.monotonic() + LONGEST

        def is_late() -> bool:
            return self._clock.monotonic() > gives_up or 0.0 < question.expires < self._clock.now()

        if not self._seats.acquire(blocking=False):
            raise RefusedError(f"{_MOST_QUESTIONS} questions wait already; ask again later")
        try:
            with self._one_at_a_time:
                return self._simulated(question, is_late)
        finally:
            self._seats.release()

    def _simulated(self, question: Question, is_late: IsLate) -> Answer:
        late = self._clock.now() - question.expires
        if question.expires and late > 0.0:
            raise RefusedError(
                f"nobody waits for this answer any more, for {late:.1f} s; too many questions, or clocks apart"
            )
        if self._offered is None or self._closed:
            raise RefusedError("the simulation handler holds no scene; it has just started, or ends")
        scene, islands, now = self._offered
        first, *others = leading(islands, scene, question.worlds) if question.worlds > 1 else [JointWorld()]
        shown = self._tried(scene, question, first, now, is_late)
        tried = [self._tried(scene, question, world, now, is_late) for world in others if not is_late()]
        return Answer(**msgspec.structs.asdict(shown), others=tuple(tried))

    def _tried(
        self, scene: RolloutScene, question: Question, world: JointWorld, now: float, is_late: IsLate
    ) -> WorldOutcome:
        """The outcome in a world, which may be that it cannot be changed so."""
        try:
            return self._outcome(scene, question, world, now, is_late)
        except (RefusedError, LateError) as error:
            otherwise = tuple(sorted(world.otherwise))
            return WorldOutcome(refused=str(error), weight=world.weight, otherwise=otherwise, stamp=now)

    def _outcome(
        self, scene: RolloutScene, question: Question, world: JointWorld, now: float, is_late: IsLate
    ) -> WorldOutcome:
        before = after = world.scene(scene)
        for change in question.changes:
            after = changed(after, change)
        check_room(after, {change.object for change in question.changes if change.pose is not None}, is_late)
        self._engine = self._engine or Engine()
        outcome = self._engine.run(after, question.seconds, is_late)
        described = _described(after, outcome, world, now)
        about = {change.object for change in question.changes}
        others = [body for body in before.bodies if body.mass > 0.0 and body.name not in about]
        if not about or not any(_moves(body, outcome) for body in others):
            return described
        alone = self._engine.run(before, question.seconds, is_late)
        anyway = {body.name: _numbers(alone.poses[body.name]) for body in others if _moves(body, alone)}
        return msgspec.structs.replace(described, anyway=anyway)


def _tried_nowhere(why: str) -> Answer:
    """The refusal of a question that was tried in no world."""
    return Answer(refused=why, weight=0.0)


def changed(scene: RolloutScene, change: Supposed) -> RolloutScene:
    """The scene with a change made. Raises `RefusedError` for one that makes no sense."""
    name = change.object
    if change.action == "add":
        return RolloutScene((*scene.bodies, added(scene, change)))
    known = [body for body in scene.names if body != FLOOR]
    if name not in known:
        raise RefusedError(f"no object {name!r} has a place in the belief; {suggest(name, known)}")
    if change.action == "remove":
        return scene.without([name])
    if change.pose is not None:
        scene = scene.moved({name: _placing(name, change.pose)})
    elif change.action == "place":
        raise RefusedError(f"change of {name!r}: to place it needs a pose")
    return scene.held([name]) if change.action == "hold" else scene.released([name])


def added(scene: RolloutScene, change: Supposed) -> RolloutBody:
    """Make the body that a change adds to the scene. Raises `RefusedError` if it cannot be, or is there already."""
    name, size = change.object, change.size
    if name in scene:
        raise RefusedError(f"{name!r} is there already; place it elsewhere instead")
    if change.pose is None or size is None:
        raise RefusedError(f"to add {name!r} takes a pose and a size")
    if not (RESOLUTION <= min(size) <= max(size) <= FARTHEST):
        raise RefusedError(f"size of {name!r}: {size}; expected {RESOLUTION} to {FARTHEST} m along each axis")
    if not MASSES[0] <= change.mass <= MASSES[1]:
        raise RefusedError(f"mass {change.mass} kg of {name!r}: expected {MASSES[0]:g} to {MASSES[1]:g}")
    if not 0.0 <= change.friction < math.inf:
        raise RefusedError(f"friction {change.friction} of {name!r}: expected a number of at least 0")
    try:
        shape = from_numbers(change.shape) if change.shape else ()
    except SchemaError as error:
        raise RefusedError(str(error)) from error
    position, rotation = _placing(name, change.pose)
    return RolloutBody(name, size, position, rotation, change.mass, change.friction, shape=shape)


def check_room(scene: RolloutScene, placed: Collection[str], is_late: IsLate = lambda: False) -> None:
    """Raise `RefusedError` if one of the objects that were `placed` would be inside another body.

    It may be so deep in one as outcomes differ anyway: physics pushes it out, but does not throw it. Raises `LateError`
    if nobody waits for that any more.
    """
    for name in sorted(placed):
        solid = scene[name].solid
        for body in scene.bodies:
            if is_late():
                raise LateError("nobody waits until it is known whether there is room for all that was placed")
            depth = 0.0 if body.name == name else _depth(solid, body.solid)
            if depth > SAME_OUTCOME:
                raise RefusedError(f"{name!r} would be {1e3 * depth:.0f} mm inside {body.name!r} there")


def _depth(a: Solid, b: Solid) -> float:
    """How far two bodies would have to be moved apart, m; zero or less if they do not overlap."""
    return max(_part_depth(p, q) for p in a.parts for q in b.parts)


def _part_depth(a: Solid, b: Solid) -> float:
    level = min(a.top, b.top) - max(a.bottom, b.bottom)
    return level if level <= 0.0 else min(level, overlap(a.footprint, b.footprint)[0])


def _placing(name: str, numbers: tuple[float, ...]) -> Placing:
    try:
        pose = Pose(numbers[:3], numbers[3:])
    except ValueError as error:
        raise RefusedError(f"pose of {name!r}: {error}") from error
    if math.hypot(*pose.t) > FARTHEST:
        raise RefusedError(f"pose of {name!r}: {math.hypot(*pose.t):.3g} m from the world's origin; at most {FARTHEST}")
    return pose.t, pose.q


def _described(scene: RolloutScene, outcome: RolloutOutcome, world: JointWorld, now: float) -> WorldOutcome:
    objects = [body for body in scene.bodies if body.mass > 0.0]
    contacts = [contact for contact in outcome.contacts if FLOOR not in contact[:2]]
    rests_on: dict[str, list[str]] = {body.name: [] for body in objects}
    for contact in contacts:
        if contact.steepness >= STEEP and contact.upper in rests_on:
            rests_on[contact.upper].append(contact.lower)
    pairs = {(min(contact[:2]), max(contact[:2])) for contact in contacts}
    return WorldOutcome(
        weight=world.weight,
        otherwise=tuple(sorted(world.otherwise)),
        stamp=now,
        seconds=outcome.seconds,
        at_rest=outcome.at_rest,
        poses={body.name: _numbers(outcome.poses[body.name]) for body in objects},
        moved={body.name: outcome.drift[body.name] for body in objects},
        turned={body.name: _angle(body, outcome) for body in objects},
        rests_on={name: tuple(supports) for name, supports in rests_on.items()},
        touches=tuple(sorted(pairs)),
        on_floor=tuple(c.upper for c in outcome.contacts if c.lower == FLOOR and c.upper in rests_on),
    )


def _numbers(placing: Placing) -> Numbers:
    return (*placing[0], *placing[1])


def _moves(body: RolloutBody, outcome: RolloutOutcome) -> bool:
    """Whether physics takes a body farther than simulations of the same beginning may differ."""
    there = Pose.unchecked(*outcome.poses[body.name])
    return not ONE_OUTCOME.covers(Pose.unchecked(body.position, body.rotation), there)


def _angle(body: RolloutBody, outcome: RolloutOutcome) -> float:
    """Between the rotation at the beginning and at the end, rad."""
    x, y, z, w = product(conjugate(body.rotation), outcome.poses[body.name][1])
    return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))
