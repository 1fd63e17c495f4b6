"""The experimenter: carries out the events of a scenario in the true world, in time or when a condition holds."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable

from agents.plant.hand_moves import begin
from agents.plant.moves import Steps
from agents.plant.stage import Stage
from agents.plant.world import RATE_HZ
from agents.scenario.format.scenario import Condition, Event, Term
from dsr.errors import DsrError

LIFTED = 0.010
"""m, the least gap below an object that is lifted"""
LOWERED = 0.020
"""m, the largest gap below an object that is being lowered"""
STILL_JOINT = 0.01
"""rad/s, the largest velocity of a joint that counts as still"""


def is_true(term: Term, stage: Stage) -> bool:
    """Whether a term of a condition holds now; false when one of its objects is not in the scene."""
    return all(name in stage.world for name in term.objects) and PREDICATES[term.predicate](stage, *term.objects)


def built(stage: Stage, upper: str, lower: str) -> bool:
    """`upper` stands on `lower`, nobody holds them and neither moves."""
    world = stage.world
    left_alone = not (stage.is_held(upper) or stage.is_held(lower))
    return left_alone and world.is_still(upper) and world.is_still(lower) and world.body(lower) in world.supports(upper)


def resting(stage: Stage, name: str) -> bool:
    """The object is supported, nobody holds it and it does not move."""
    return not stage.is_held(name) and stage.world.is_still(name) and bool(stage.world.supports(name))


def lifted(stage: Stage, name: str) -> bool:
    """The object is more than `LIFTED` above whatever lies below it."""
    return not stage.world.has_below(name, LIFTED)


def held(stage: Stage, name: str) -> bool:
    """The object is in a gripper."""
    return stage.is_gripped(name)


def lowering(stage: Stage, upper: str, lower: str) -> bool:
    """A gripper holds `upper` over `lower`, its bottom less than `LOWERED` above the other's top."""
    if not stage.is_gripped(upper):
        return False
    (x, y, z), (x_below, y_below, z_below) = stage.world.pose(upper).t, stage.world.pose(lower).t
    sizes = stage.world.specs[upper].size, stage.world.specs[lower].size
    gap = z - z_below - (sizes[0][2] + sizes[1][2]) / 2
    return math.hypot(x - x_below, y - y_below) < min(sizes[1][:2]) / 2 and 0.0 < gap < LOWERED


def idle(stage: Stage) -> bool:
    """The grippers hold nothing and no arm moves."""
    return all(arm.held is None and max(map(abs, arm.velocities)) < STILL_JOINT for arm in stage.arms.values())


PREDICATES: dict[str, Callable[..., bool]] = {
    "built": built,
    "resting": resting,
    "lifted": lifted,
    "held": held,
    "lowering": lowering,
    "idle": idle,
}
"""Predicates by their name in a condition."""
PASSING = frozenset({"lowering"})
"""Predicates on motion, which need not last to count."""


log = logging.getLogger("agents.plant.experimenter")

CONDITION_EVERY = RATE_HZ // 20
"""Physics steps between two looks at the conditions."""
CONDITION_LOOKS = 4
"""Looks in a row at which a condition must hold, so that a passing contact does not count; 1 for `PASSING` ones."""


class Experimenter:
    """Events of a scenario, waiting and under way.

    Args:
        events: all of the scenario. Of those of the runner it only tells when their condition has come true.
        stage: where they take place.
    """

    def __init__(self, events: Iterable[Event], stage: Stage) -> None:
        self._stage = stage
        numbered = enumerate(events, start=1)
        mine = [(n, event) for n, event in numbered if not event.by_runner or event.condition is not None]
        self._scheduled = [(event.at + event.delay, n, event) for n, event in mine if event.at is not None]
        self._waiting = [_Waiting(n, event, event.condition) for n, event in mine if event.condition is not None]
        self._running: dict[int, Steps] = {}
        self._steps = 0
        self.spans: dict[int, tuple[float, float | None]] = {}
        """By the number of an event (in the file, from 1): when its move began and ended, s after the start."""
        self.given_up: dict[int, str] = {}
        """By the number of an event whose move could not be carried out: why."""

    @property
    def is_done(self) -> bool:
        """Whether nothing is left to do."""
        return not (self._scheduled or self._waiting or self._running)

    def step(self, elapsed: float) -> None:
        """Act for the next step of physics, `elapsed` s after the start of the scenario."""
        if self._steps % CONDITION_EVERY == 0:
            self._look(elapsed)
        self._steps += 1
        due = [(number, event) for start, number, event in self._scheduled if start <= elapsed]
        if due:
            self._scheduled = [entry for entry in self._scheduled if entry[0] > elapsed]
        for number, event in due:
            self._running[number] = begin(event, self._stage)
            self.spans[number] = (elapsed, None)
        for number in [number for number, steps in self._running.items() if not self._advance(number, steps)]:
            del self._running[number]
            self.spans[number] = (self.spans[number][0], elapsed)
        self._stage.act()

    def _look(self, elapsed: float) -> None:
        """Schedule the events whose condition has come true."""
        for waiting in self._waiting:
            waiting.look(self._stage)
        ready = [waiting for waiting in self._waiting if waiting.is_ready]
        self._waiting = [waiting for waiting in self._waiting if not waiting.is_ready]
        self._scheduled += [(elapsed + entry.event.delay, entry.number, entry.event) for entry in ready]

    def _advance(self, number: int, steps: Steps) -> bool:
        """Whether the move goes on; one that cannot be carried out is logged, noted and given up."""
        try:
            next(steps)
        except StopIteration:
            return False
        except DsrError as error:
            log.warning("event %d given up: %s", number, error)
            self.given_up[number] = str(error)
            return False
        return True


class _Waiting:
    """An event with its condition, and at how many looks in a row that held."""

    def __init__(self, number: int, event: Event, condition: Condition) -> None:
        self.number = number
        self.event = event
        self._condition = condition
        self._needed = 1 if any(term.predicate in PASSING for term in condition.terms) else CONDITION_LOOKS
        self._looks = 0

    @property
    def is_ready(self) -> bool:
        return self._looks >= self._needed

    def look(self, stage: Stage) -> None:
        holds = self._condition.holds(lambda term: is_true(term, stage))
        self._looks = self._looks + 1 if holds else 0
