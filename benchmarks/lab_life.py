"""A made-up life of a lab over days: things that people and a robot move about, its truth, and its timeline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from dsr.clock import ManualClock
from dsr.memory import Memory
from dsr.network.local_transport import LocalNetwork
from dsr.timeline import Chronicle, Consolidator, Retention
from dsr.vocabulary.explained import MOVED, ExplainedChange, encoded, text_of

START = 1_767_571_200.0
"""s, Monday 5 January 2026, 0:00 UTC"""
DAY, HOUR = 86400.0, 3600.0
_OPEN, _CLOSE = 8.0, 18.0
"""h UTC between which things are moved"""
_HELD = 8.0
"""s for which a thing is carried from one place to another"""
_UNSEEN = 0.1
"""Share of the moves that nobody sees: the robot is surprised, and concludes that the thing was moved"""
_FLICKER = 0.2
"""Share of the moves after which contact is lost for half a second once, as physics does"""
THINGS = tuple(f"{name}_{number}" for name in ("cup", "book", "tool", "cube", "ball") for number in (1, 2))
PLACES = ("table", "shelf", "bench", "cabinet")
BOXES = ("red_box", "blue_box")
HANDS = ("anne", "ben", "carl", "gripper")


T = TypeVar("T")


def chosen(rng: np.random.Generator, among: Sequence[T]) -> T:
    """One of several, each as likely."""
    return among[int(rng.integers(len(among)))]


class Move(NamedTuple):
    """A thing was moved, in truth."""

    time: float
    """s, when it was taken"""
    thing: str
    place: str
    """Where it is from then on."""
    by: str
    is_unseen: bool


class Lab:
    """The lab, its memory, and what truly was.

    Args:
        moves_per_day: on average, on each working day.
        seed: of all that is random.
    """

    def __init__(self, moves_per_day: float, seed: int) -> None:
        self.clock = ManualClock(START)
        transport = LocalNetwork(self.clock).connect("chronicler")
        self.memory = Memory("lab", "chronicler", transport=transport, clock=self.clock)
        self.moves: list[Move] = []
        """In order."""
        self._rng = np.random.default_rng(seed)
        self._per_day = moves_per_day
        self._chronicle = Chronicle(self.memory, "chronicler", keep=Retention(1000, HOUR))
        self._consolidator = Consolidator(self.memory)
        self._open: dict[str, str] = {}
        for name in (*PLACES, *BOXES, *THINGS):
            self.memory.add_node(name, "container" if name in BOXES else "table" if name in PLACES else "object")
        for thing in THINGS:
            self._move(Move(START, thing, chosen(self._rng, PLACES), chosen(self._rng, HANDS), False))

    def live(self, days: int) -> None:
        """Go on for so many days."""
        begin = self.clock.now()
        for day in range(days):
            midnight = begin + day * DAY
            is_working = int((midnight - START) // DAY) % 7 < 5
            count = round(self._per_day * self._rng.uniform(0.5, 1.5)) if is_working else 0
            hours = sorted(float(self._rng.uniform(_OPEN, _CLOSE)) for _ in range(count))
            for hour in hours:
                self._pass_time(max(midnight + hour * HOUR, self.clock.now() + 30.0))
                self._move(self._next_move())
            self._pass_time(midnight + DAY)

    def place(self, thing: str, time: float) -> str:
        """Where a thing truly was at a time (s)."""
        return [move.place for move in self.moves if move.thing == thing and move.time <= time][-1]

    def during(self, begin: float, end: float, thing: str) -> list[Move]:
        """The true moves of a thing in a time (s)."""
        return [move for move in self.moves if move.thing == thing and begin <= move.time < end]

    def _next_move(self) -> Move:
        rng = self._rng
        thing = chosen(rng, THINGS)
        others = [place for place in (*PLACES, *BOXES) if place != self.place(thing, self.clock.now())]
        return Move(self.clock.now(), thing, chosen(rng, others), chosen(rng, HANDS), rng.random() < _UNSEEN)

    def _move(self, move: Move) -> None:
        """Do it, and tell of it as the agents would."""
        chronicle, now = self._chronicle, self.clock.now()
        self.moves.append(move)
        if move.thing in self._open:
            chronicle.end(self._open[move.thing], now)
        if move.is_unseen:
            surprise = chronicle.begin("surprising", (move.thing,), now, text=f"{move.thing} is surprising: moved")
            changes = (ExplainedChange(MOVED, ((move.thing,),)),)
            why, what = text_of(changes), encoded(changes)
            chronicle.happened("explained", (move.thing,), now + 1.0, explanation=why, changes=what)
            chronicle.end(surprise, now + 1.0)
        else:
            held = chronicle.begin("grasping", (move.by, move.thing), now, source="contact")
            chronicle.happened("Pick", (move.thing, move.by), now, confidence=0.95)
            chronicle.end(held, now + _HELD)
            chronicle.happened("Place", (move.thing, move.by), now + _HELD, confidence=0.95)
        self._rest(move, now if move.is_unseen else now + _HELD)

    def _rest(self, move: Move, time: float) -> None:
        """It comes to rest, for good or after half a second without contact."""
        relation, name = "in" if move.place in BOXES else "on", (move.thing, move.place)
        if self._rng.random() < _FLICKER:
            first = self._chronicle.begin(relation, name, time, source="contact")
            self._chronicle.end(first, time + 2.0)
            time += 2.5
        self._open[move.thing] = self._chronicle.begin(relation, name, time, source="contact")

    def _pass_time(self, until: float) -> None:
        """Go to a time, with the looks that the chronicler takes meanwhile: one an hour is enough while nothing is."""
        while self.clock.now() < until:
            self.clock.advance_to(min(until, self.clock.now() + HOUR))
            self._consolidator.update()
            self._chronicle.forget()
