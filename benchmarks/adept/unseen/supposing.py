"""What there may be, as a few hypotheses of which percept is of which thing; each thing moves by itself.

Percepts have no names: a hypothesis says which known thing each is of, or that it is of a stranger.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.adept.unseen.ghosts import Ghosts, Mechanics
from benchmarks.adept.unseen.motions import Body, Components, Fixed, Motions
from benchmarks.adept.unseen.rates import EventRates
from benchmarks.adept.unseen.sight import CameraSight
from benchmarks.adept.unseen.strangers import LookedAt, Trail, stranger
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Part

Array = NDArray[np.float64]

_MOST_HYPOTHESES = 6  # hypotheses
_IMPOSSIBLE = -20.0  # nats, below which a hypothesis does not count
_AMBIGUOUS = 15.0  # nats by which another reading of the percepts may be worse and still be followed
_REMEMBERED = 3  # frames from one remembered view to the next
_MOST_REMEMBERED = 120  # views


_Born = tuple[Components, float]


class RecognisedThing(NamedTuple):
    """Something of a kind that was recognised."""

    kind: str
    """Things of one kind look the same"""
    size: Vector3
    """(3,) m"""
    position: Array
    """(3,) m in the world"""
    rotation: Quaternion
    """world_from_thing"""


@dataclass(frozen=True)
class _Hypothesis:
    """Things that there are, and how probable it is that these are the ones."""

    things: Mapping[str, Motions]
    kinds: Mapping[str, str]
    trails: Mapping[str, tuple[Array | None, ...]]
    mass: Array
    """(W + 1,) nats, as the mass of components"""


class Improbability(NamedTuple):
    """How improbable what was seen lately is under the whole belief."""

    nats: float
    """In all"""
    shares: Mapping[str, float]
    """The part of each thing, nats, in the most probable hypothesis"""


class Supposing:
    """A belief about things without names, some of which are out of sight.

    Args:
        mechanics: how things move.
        prior: how often things happen that nobody sees.
        window: s that are judged together: what is seen in them belongs to one event.
        rate: 1/s, frames.
        seed: of what is drawn.
    """

    def __init__(self, mechanics: Mechanics, prior: EventRates, window: float, rate: float, seed: int = 0) -> None:
        self._mechanics = mechanics
        self._prior = prior
        self._window = window
        self._columns = round(window * rate) + 1
        self._seed = seed
        self._ghosts: dict[str, Ghosts] = {}
        self._hypotheses = [_Hypothesis({}, {}, {}, np.zeros(self._columns))]
        self._memory = LookedAt([], [])
        self._now: float | None = None
        self._frames = 0

    def close(self) -> None:
        """Free the simulations."""
        for ghosts in self._ghosts.values():
            ghosts.close()

    def step(self, now: float, sight: CameraSight, percepts: Sequence[RecognisedThing]) -> Improbability:
        """Take in a frame at time `now` (s): what a camera could see, and what it recognised."""
        if self._now is not None:
            self._predict(now - self._now)
        sights = [self._look(one, sight) for one in self._hypotheses]
        children = [child for hypothesis in self._hypotheses for child in self._readings(hypothesis, percepts, now)]
        self._keep(children)
        if self._frames % _REMEMBERED == 0:
            self._remember(now, sights[0])
        self._now = now
        self._frames += 1
        return self._judge()

    def _predict(self, seconds: float) -> None:
        """Move every thing on once, whatever hypotheses it is in."""
        moved: dict[int, Motions] = {}
        hypotheses = []
        for hypothesis in self._hypotheses:
            bodies = {name: (thing.size, thing.best) for name, thing in hypothesis.things.items() if thing.stands}
            things = {}
            for name, thing in hypothesis.things.items():
                if id(thing) not in moved:
                    others: Fixed = {
                        other: (size, tuple(best[0].tolist()), best[1])
                        for other, (size, best) in bodies.items()
                        if other != name and best is not None and not thing.overlaps(size, best[0])
                    }
                    moved[id(thing)] = thing.copy()
                    moved[id(thing)].predict(seconds, self._ghosts_of(hypothesis.kinds[name], thing.size), others)
                things[name] = moved[id(thing)]
            mass = np.concatenate([hypothesis.mass[:1], hypothesis.mass[:-1]])
            hypotheses.append(replace(hypothesis, things=things, mass=mass))
        self._hypotheses = hypotheses

    def _ghosts_of(self, kind: str, size: Vector3) -> Ghosts:
        if kind not in self._ghosts:
            self._ghosts[kind] = Ghosts(size, self._mechanics)
        return self._ghosts[kind]

    def _look(self, hypothesis: _Hypothesis, sight: CameraSight) -> CameraSight:
        """What a camera could see if things are where they are believed most."""
        bodies = {name: (thing.size, best) for name, thing in hypothesis.things.items() if (best := thing.best)}
        parts = [Part("box", size, tuple(best[0].tolist()), best[1]) for size, best in bodies.values()]
        whole = replace(sight, obstacles=(*sight.obstacles, *parts), names=(*sight.names, *bodies))
        for thing in hypothesis.things.values():
            thing.look(whole)
        return sight

    def _readings(
        self, hypothesis: _Hypothesis, percepts: Sequence[RecognisedThing], now: float
    ) -> Iterator[_Hypothesis]:
        """The ways to read percepts under a hypothesis that are not much worse than the best."""
        bodies = [(percept.size, percept.position) for percept in percepts]
        absent = {name: thing.evidence(thing.absence(bodies)) for name, thing in hypothesis.things.items()}
        scores = [
            {
                name: thing.evidence(thing.presence(percept.position, _without(bodies, index))) - absent[name]
                for name, thing in hypothesis.things.items()
                if hypothesis.kinds[name] == percept.kind
            }
            for index, percept in enumerate(percepts)
        ]
        limit = math.log(self._prior.strangers)
        new = [
            None
            if any(score > limit and hypothesis.things[name].seen for name, score in row.items())
            else self._stranger(hypothesis, percept, now)
            for percept, row in zip(percepts, scores, strict=True)
        ]
        for row, born in zip(scores, new, strict=True):
            if born is not None:
                row[""] = born[1]
        readings = list(_assignments(scores))
        best = max((score for score, _ in readings), default=0.0)
        for score, names in readings:
            if score > best - _AMBIGUOUS:
                yield self._read(hypothesis, percepts, names, new, score + sum(absent.values()))

    def _stranger(self, hypothesis: _Hypothesis, percept: RecognisedThing, now: float) -> _Born:
        """The components of a thing that nobody knew of, and the probability (nats) of such a thing."""
        trails = [Trail(hypothesis.things[name].size, trail) for name, trail in hypothesis.trails.items()]
        return stranger(
            percept.size, percept.position, percept.rotation, now, self._memory, trails, self._prior, self._columns,
            self._seed + self._frames,
        )  # fmt: skip

    def _read(
        self,
        hypothesis: _Hypothesis,
        percepts: Sequence[RecognisedThing],
        names: Sequence[str],
        new: Sequence[_Born | None],
        score: float,
    ) -> _Hypothesis:
        """What is believed if the percepts are of the things of these names, or of strangers where there is none."""
        things, kinds, trails = dict(hypothesis.things), dict(hypothesis.kinds), dict(hypothesis.trails)
        bodies = [(percept.size, percept.position) for percept in percepts]
        seen = {name: index for index, name in enumerate(names) if name}
        for name, thing in hypothesis.things.items():
            things[name] = thing.copy()
            if name in seen:
                percept, others = percepts[seen[name]], _without(bodies, seen[name])
                likelihood = thing.presence(percept.position, others)
                things[name].take_in(likelihood, percept.position, percept.rotation)
            else:
                things[name].take_in(thing.absence(bodies), None, None)
        for name, percept, born in zip(names, percepts, new, strict=True):
            if not name and born is not None:
                called = f"{percept.kind}_{self._frames}_{len(things)}"
                components, _ = born
                things[called] = Motions(
                    called, percept.size, components, self._prior, self._window, self._seed + self._frames + len(things)
                )
                kinds[called] = percept.kind
                trails[called] = (None,) * len(self._memory.times)
        mass = hypothesis.mass.copy()
        mass[0] += score
        return _Hypothesis(things, kinds, trails, mass)

    def _keep(self, children: list[_Hypothesis]) -> None:
        children.sort(key=lambda child: -child.mass[0])
        total = float(np.logaddexp.reduce([child.mass[0] for child in children]))
        kept = [child for child in children[:_MOST_HYPOTHESES] if child.mass[0] > total + _IMPOSSIBLE]
        total = float(np.logaddexp.reduce([child.mass[0] for child in kept]))
        for child in kept:
            child.mass[0] -= total
        self._hypotheses = kept

    def _remember(self, now: float, sight: CameraSight) -> None:
        times, sights = [*self._memory.times, now], [*self._memory.sights, sight]
        drop = max(len(times) - _MOST_REMEMBERED, 0)
        self._memory = LookedAt(times[drop:], sights[drop:])
        self._hypotheses = [
            replace(
                hypothesis,
                trails={
                    name: (*hypothesis.trails[name], best[0] if (best := thing.best) else None)[drop:]
                    for name, thing in hypothesis.things.items()
                },
            )
            for hypothesis in self._hypotheses
        ]

    def _judge(self) -> Improbability:
        frames = min(self._frames, self._columns) - 1
        weights = np.exp([hypothesis.mass[0] for hypothesis in self._hypotheses])
        total = 0.0
        shares: dict[str, float] = {}
        for weight, hypothesis in zip(weights, self._hypotheses, strict=True):
            parts = {name: thing.improbability(frames) for name, thing in hypothesis.things.items()}
            shares = shares or parts
            own = hypothesis.mass[0] - hypothesis.mass[frames]
            total += weight * (own + sum(parts.values()))
        return Improbability(max(total, 0.0), shares)


def _without(bodies: list[Body], index: int) -> list[Body]:
    return bodies[:index] + bodies[index + 1 :]


def _assignments(scores: Sequence[Mapping[str, float]]) -> Iterator[tuple[float, tuple[str, ...]]]:
    """All ways to give each percept a thing of its own, or nobody (""), with their scores."""
    if not scores:
        yield 0.0, ()
        return
    for score, names in _assignments(scores[1:]):
        for name, own in scores[0].items():
            if not name or name not in names:
                yield score + own, (name, *names)
