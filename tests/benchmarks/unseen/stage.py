"""A floor with a screen before a camera, and boxes that slide without friction: frames as a belief gets them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.adept.cases import CAMERA, LENS
from benchmarks.adept.unseen.ghosts import Mechanics
from benchmarks.adept.unseen.rates import EventRates
from benchmarks.adept.unseen.sight import CameraSight
from benchmarks.adept.unseen.supposing import RecognisedThing, Supposing
from dsr.math3d.shapes import Part

RATE = 25.0
SIZE = (0.6, 0.6, 0.6)
SCREEN = Part("box", (0.08, 2.0, 1.5), (0.2, 0.0, 0.75))
SLIDING = Mechanics(gravity=1.0, friction=0.0, restitution=0.9)
Course = Callable[[float], tuple[float, float] | None]
"""x and y (m) of a thing at a time (s); None while it is not there"""


class Stage:
    """Plays courses of things to a belief."""

    def __init__(self, seed: int = 0, prior: EventRates | None = None) -> None:
        self.belief = Supposing(SLIDING, prior or EventRates(), 1.0, RATE, seed)
        self.nats: list[float] = []

    def play(self, seconds: float, *courses: Course, screen: Callable[[float], bool] = lambda _: True) -> list[float]:
        """The surprise of every frame; `screen` tells whether the screen stands at a time (s)."""
        for frame in range(round(seconds * RATE)):
            time = frame / RATE
            sight = CameraSight(CAMERA, LENS, (SCREEN,), ("screen",)) if screen(time) else CameraSight(CAMERA, LENS)
            places = [np.array((*at, 0.3)) for course in courses if (at := course(time)) is not None]
            percepts = [
                RecognisedThing("box", SIZE, place, (0.0, 0.0, 0.0, 1.0))
                for place in places
                if sight.shares("", SIZE, place[None], np.eye(3)[None])[0] >= 0.5
            ]
            self.nats.append(self.belief.step(time, sight, percepts).nats)
        self.belief.close()
        return self.nats


def sliding(begin: float = -2.2, speed: float = 1.0, x: float = -0.6) -> Course:
    """Along y from a place (m)."""
    return lambda time: (x, begin + speed * time)
