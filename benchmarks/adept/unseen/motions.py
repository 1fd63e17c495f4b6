"""Where one thing may be and how it may move: weighted Gaussian components that physics moves on.

Every component also knows what the belief of some frames ago thought of it without what was seen since. How improbable
that made what was seen is the divergence between the two (`improbability`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.adept.unseen.ghosts import Ghosts, States
from benchmarks.adept.unseen.rates import EventRates
from benchmarks.adept.unseen.sight import CameraSight, matrices
from dsr.math3d.quaternions import Quaternion, Vector3

Array = NDArray[np.float64]
Indexes = NDArray[np.int64]
Fixed = Mapping[str, tuple[Vector3, Vector3, Quaternion]]
"""Bodies in the way: size (m), position (m) and rotation by name."""

Body = tuple[Vector3, Array]
"""Size (m) and place (3,) m of something that is seen"""

_NEVER = -1e3  # nats, stands for minus infinity
_LEAST_MASS = -25.0  # nats below which a component does not count
HORIZONTAL = np.array((1.0, 1.0, 0.0))
"""(3,) the coordinates in which things are pushed"""
TOUCH = 0.8
"""1, share of the sum of two half edges within which two things are in one place"""
_UNIFORM = 1.0 / 12.0  # 1, variance of a uniform distribution over a length, by its square
_CHILDREN = 3  # components that an unseen push makes, one of which rests
_DRAWN_VELOCITIES = 4  # components as which a velocity that percepts will not tell is taken
_EVENTS = 0.15  # s, between the times at which something may happen to what nobody sees
_MOST_COMPONENTS = 128  # components
_STANDS = 0.1  # of the speed that a push gives, below which a thing rests
_APART = 0.4  # of that speed, standard deviation of the velocity of each component that a push makes
_SURE = 0.5  # probability of its surroundings from which a resting place is one that others meet
_WIDE = 0.6  # of the speed that a push gives, from which an unseen velocity is taken as several


@dataclass
class Components:
    """K components, of the present thing, and the mass of its absence."""

    states: States
    spread: Array
    """(K, 3) variances of each coordinate of position (m^2), of both (m^2/s), and of velocity (m^2/s^2)"""
    most: Array
    """(K,) 1, greatest visible share since the thing was recognised last"""
    mass: Array
    """(K, W + 1) nats, logarithm of the probability that a belief of so many frames ago gives to the component"""
    gone: Array
    """(W + 1,) likewise of that there is no such thing any more"""

    def take(self, chosen: Indexes) -> Components:
        """Some of the components, by index."""
        parts = States(*(part[chosen] for part in self.states))
        return Components(parts, self.spread[chosen], self.most[chosen], self.mass[chosen], self.gone)

    def and_also(self, other: Components) -> Components:
        """These, and those of another set; the mass of absence is that of these."""
        states = States(*(np.concatenate(pair) for pair in zip(self.states, other.states, strict=True)))
        return Components(
            states,
            np.concatenate([self.spread, other.spread]),
            np.concatenate([self.most, other.most]),
            np.concatenate([self.mass, other.mass]),
            self.gone,
        )


class Motions:
    """The components of one thing.

    Args:
        name: of the thing.
        size: (3,) m.
        components: what is believed of it at first.
        prior: rates.
        window: s, that is judged together.
        seed: of the motions that are drawn.
    """

    def __init__(
        self, name: str, size: Vector3, components: Components, prior: EventRates, window: float, seed: int
    ) -> None:
        self.name = name
        self.size = size
        self.seen = True
        """Whether the thing was recognised in the last frame."""
        self._prior = prior
        self._parts = components
        self._random = np.random.default_rng(seed)
        self._waited = 0.0
        self._window = window
        self._shares: Array = np.zeros(0)

    def copy(self) -> Motions:
        """The same, to go on otherwise."""
        twin = object.__new__(Motions)
        twin.__dict__.update(self.__dict__)
        twin._random = np.random.default_rng(self._random.integers(np.iinfo(np.int64).max))
        return twin

    @property
    def best(self) -> tuple[Array, Quaternion] | None:
        """Position and rotation in the most probable component; None if absence is more probable."""
        if not len(self._parts.mass) or self._parts.gone[0] > self._parts.mass[:, 0].max():
            return None
        index = int(self._parts.mass[:, 0].argmax())
        x, y, z, w = self._parts.states.rotation[index].tolist()
        return self._parts.states.position[index], (x, y, z, w)

    @property
    def stands(self) -> bool:
        """Whether others meet it where it is believed most: it is seen there, or rests there."""
        if self.seen or not len(self._parts.mass):
            return True
        index = int(self._parts.mass[:, 0].argmax())
        if float(np.linalg.norm(self._parts.states.velocity[index])) >= _STANDS * self._prior.push_speed:
            return False
        apart = np.abs(self._parts.states.position - self._parts.states.position[index]).max(axis=1)
        return float(np.exp(self._parts.mass[apart < 0.5 * min(self.size), 0]).sum()) > _SURE

    def overlaps(self, size: Vector3, place: Array) -> bool:
        """Whether the most probable place is in that of another thing."""
        best = self.best
        within = TOUCH * 0.5 * (np.array(self.size) + np.array(size))
        return best is not None and bool((np.abs(best[0] - place) < within).all())

    @property
    def probability_gone(self) -> float:
        """Probability that the thing is not there any more."""
        return math.exp(self._parts.gone[0])

    def predict(self, seconds: float, ghosts: Ghosts, fixed: Fixed) -> None:
        """Let time (s) pass: physics moves every component on, and something may happen to each."""
        parts, prior = self._parts, self._prior
        if not len(parts.mass):
            return
        speed = np.linalg.norm(parts.states.velocity, axis=1)
        parts = Components(
            _moved(parts.states, speed > 0.0, ghosts, seconds, fixed),
            _spread_on(parts.spread, seconds, prior.drift * (speed > _STANDS * prior.push_speed)),
            parts.most,
            np.concatenate([parts.mass[:, :1], parts.mass[:, :-1]], axis=1),
            np.concatenate([parts.gone[:1], parts.gone[:-1]]),
        )
        parts.gone = np.logaddexp(parts.gone, _total(parts.mass) + math.log(prior.wonder_rate * seconds))
        self._parts = parts
        self._waited = self._waited + seconds
        if self.seen or self._waited >= _EVENTS:
            waited, self._waited = self._waited, 0.0
            self._parts = parts.and_also(self._pushed(waited, self._in_sight() if self.seen else self._unseen(waited)))
        self._reduce()

    def _pushed(self, seconds: float, children: Components) -> Components:
        """Weigh what a push makes of the components. When it happened in the window that is judged is no news."""
        children.mass = children.mass + math.log(self._prior.push_rate * self._window)
        children.mass[:, 0] += math.log(seconds / self._window)
        return children

    def _in_sight(self) -> Components:
        """The most probable component, with a velocity that percepts will tell."""
        child = self._parts.take(np.array([self._parts.mass[:, 0].argmax()]))
        child.spread = child.spread + np.array([0.0, 0.0, self._prior.push_speed**2])
        return child

    def _unseen(self, waited: float) -> Components:
        """Three components, drawn by their weight: one is stopped, two are pushed somewhere."""
        weights = np.exp(self._parts.mass[:, 0])
        chosen = self._random.choice(len(weights), _CHILDREN, p=weights / weights.sum())
        children = self._parts.take(chosen)
        stops = self._prior.stops
        shares = np.log([stops, 0.5 * (1.0 - stops), 0.5 * (1.0 - stops)])
        drawn = math.log(weights.sum()) - children.mass[:, :1]
        children.mass = children.mass + drawn + shares[:, None]
        push = self._random.normal(0.0, self._prior.push_speed, (_CHILDREN, len(HORIZONTAL))) * HORIZONTAL
        velocity = children.states.velocity + push
        velocity[0] = 0.0
        passed = float((children.states.velocity[0] ** 2).sum()) * waited**2
        children.spread[0] = (children.spread[0, 0] + passed * _UNIFORM, 0.0, 0.0)
        children.spread[1:, 2] += (_APART * self._prior.push_speed) ** 2
        children.states = children.states._replace(velocity=velocity)
        return children

    def look(self, sight: CameraSight) -> None:
        """Find how much would be seen of every component."""
        states = self._parts.states
        self._shares = sight.shares(self.name, self.size, states.position, matrices(states.rotation))

    def absence(self, others: Sequence[Body]) -> Array:
        """(K + 1,) nats, logarithm of the probability that it is not recognised, of each component and of absence.

        The share from which a thing is recognised is not known, but the same in all frames. Where others are seen, it
        is not.
        """
        prior, parts = self._prior, self._parts
        before = _unrecognised(parts.most, prior)
        after = _unrecognised(np.maximum(parts.most, self._shares), prior)
        again = (self._shares >= prior.seen_at) & (parts.most >= prior.seen_at)
        return np.append(np.log(after / before) + again * math.log(prior.missed) + self._taken(others), 0.0)

    def _taken(self, others: Sequence[Body]) -> Array:
        """(K,) nats, that something else is seen to be where each component is."""
        taken = np.zeros(len(self._parts.mass))
        for size, place in others:
            within = TOUCH * 0.5 * (np.array(self.size) + np.array(size))
            taken += (np.abs(self._parts.states.position - place) < within).all(axis=1)
        return taken * math.log(self._prior.wonder_rate)

    def presence(self, place: Array, others: Sequence[Body]) -> Array:
        """(K + 1,) nats, likewise that it is recognised about there (3,): within the resolution of percepts."""
        prior, parts = self._prior, self._parts
        known = np.clip((self._shares - prior.seen_from) / (prior.seen_at - prior.seen_from), 0.0, 1.0)
        recognised = np.log(prior.misplaced + (1.0 - prior.missed - prior.misplaced) * known)
        noise = prior.resolution**2
        variance = parts.spread[:, 0] + noise
        off = (parts.states.position - place) ** 2
        squared = off[:, :2].sum(axis=1) / variance + off[:, 2] / noise  # gravity leaves no doubt about the height
        return np.append(recognised + np.log(noise / variance) - 0.5 * squared + self._taken(others), _NEVER)

    def evidence(self, likelihood: Array) -> float:
        """Nats, logarithm of the probability of what is seen, by (K + 1,) that of each component and of absence."""
        return float(np.logaddexp.reduce(np.append(self._parts.mass[:, 0], self._parts.gone[0]) + likelihood))

    def take_in(self, likelihood: Array, place: Array | None, rotation: Quaternion | None) -> None:
        """Weigh the components, and move those of what is recognised at a place (3,) towards it."""
        total = self.evidence(likelihood)
        parts = self._parts = replace(self._parts, mass=self._parts.mass.copy(), gone=self._parts.gone.copy())
        parts.mass[:, 0] += likelihood[:-1] - total
        parts.gone[0] += likelihood[-1] - total
        self.seen = place is not None
        if place is None:
            parts.most = np.maximum(parts.most, self._shares)
        else:
            parts.most = np.zeros(len(parts.most))
            self._correct(place, rotation)
        self._reduce()
        if place is None:
            self._resolve()

    def _correct(self, place: Array, rotation: Quaternion | None) -> None:
        """Kalman update with alike noise in all coordinates."""
        parts = self._parts
        own, both, speed = parts.spread.T
        variance = own + self._prior.resolution**2
        off = place - parts.states.position
        position = parts.states.position + (own / variance)[:, None] * off
        velocity = parts.states.velocity + (both / variance)[:, None] * off
        turned = np.tile(rotation, (len(own), 1)) if rotation is not None else parts.states.rotation
        parts.states = States(position, turned, velocity, parts.states.spin)
        parts.spread = np.stack([own - own * own / variance, both - own * both / variance,
                                 speed - both * both / variance], axis=1)  # fmt: skip

    def _resolve(self) -> None:
        """Take each component whose velocity is unknown as several that are known, when no percept will tell."""
        parts = self._parts
        wide = parts.spread[:, 2] > (_WIDE * self._prior.push_speed) ** 2
        if not wide.any():
            return
        some = parts.take(np.flatnonzero(wide))
        drawn = []
        for _ in range(_DRAWN_VELOCITIES):
            deviation = np.sqrt(some.spread[:, 2])[:, None]
            push = self._random.normal(0.0, 1.0, some.states.velocity.shape) * deviation * HORIZONTAL
            part = some.take(np.arange(len(deviation)))
            part.states = part.states._replace(velocity=part.states.velocity + push)
            part.spread = part.spread * (1.0, 0.0, 0.0) + (0.0, 0.0, (_APART * self._prior.push_speed) ** 2)
            part.mass = part.mass - math.log(_DRAWN_VELOCITIES)
            drawn.append(part)
        self._parts = parts.take(np.flatnonzero(~wide))
        for part in drawn:
            self._parts = self._parts.and_also(part)
        self._reduce()

    def improbability(self, frames: int) -> float:
        """Nats: how far the belief is from what it was so many frames ago, without what was seen since."""
        mass = np.concatenate([self._parts.mass, self._parts.gone[None]])
        kept = mass[mass[:, 0] > _LEAST_MASS]
        weights = np.exp(kept[:, 0])
        return max(float((weights * (kept[:, 0] - kept[:, frames])).sum() / weights.sum()), 0.0)

    def _reduce(self) -> None:
        """Leave out what is as good as impossible, and of the rest so many that there are at most `_MOST`."""
        parts = self._parts
        kept = np.flatnonzero(parts.mass[:, 0] > _LEAST_MASS)
        parts = parts.take(kept)
        if len(kept) > _MOST_COMPONENTS:
            parts = parts.take(self._drawn(parts))
        self._parts = parts
        lost = np.logaddexp.reduce(np.append(parts.mass[:, 0], parts.gone[0]))
        parts.mass = parts.mass.copy()
        parts.gone = parts.gone.copy()
        parts.mass[:, 0] -= lost
        parts.gone[0] -= lost

    def _drawn(self, parts: Components) -> Indexes:
        """Priority sampling: a component below a limit survives in proportion to its weight, and gets the limit."""
        weights = np.exp(parts.mass[:, 0])
        limit = _limit(weights, _MOST_COMPONENTS)
        chance = np.minimum(weights / limit, 1.0)
        edges = np.cumsum(chance) + self._random.random()
        chosen = np.flatnonzero(np.floor(edges) > np.floor(np.concatenate([edges[:1] - chance[:1], edges[:-1]])))
        parts.mass = parts.mass - np.log(chance)[:, None]
        return np.asarray(chosen)


def _limit(weights: Array, count: int) -> float:
    """The weight up to which components are drawn, so that `count` are left on average (Duffield et al. 2007)."""
    ordered = np.sort(weights)
    sums = np.cumsum(ordered)
    for index in range(len(ordered)):
        larger = len(ordered) - index - 1
        if larger < count:
            limit = float(sums[index] / (count - larger))
            if index + 1 == len(ordered) or limit <= ordered[index + 1]:
                return max(limit, np.finfo(np.float64).tiny)
    return float(ordered[-1])


def _moved(states: States, moving: NDArray[np.bool_], ghosts: Ghosts, seconds: float, fixed: Fixed) -> States:
    """The states after a time (s); those at rest stay as they are."""
    if not moving.any():
        return states
    after = ghosts.advance(States(*(part[moving] for part in states)), seconds, fixed)
    whole = States(*(part.copy() for part in states))
    for part, new in zip(whole, after, strict=True):
        part[moving] = new
    return whole


def _spread_on(spread: Array, seconds: float, drift: Array) -> Array:
    own, both, speed = spread.T
    return np.stack(
        [own + 2.0 * seconds * both + seconds**2 * speed, both + seconds * speed, speed + drift**2 * seconds], axis=1
    )


def _unrecognised(share: Array, prior: EventRates) -> Array:
    """Probability that the limit from which a thing is recognised is above a share."""
    known = np.clip((share - prior.seen_from) / (prior.seen_at - prior.seen_from), 0.0, 1.0)
    return np.asarray(np.maximum(1.0 - known, prior.missed))


def _total(mass: Array) -> Array:
    return np.asarray(np.logaddexp.reduce(mass, axis=0))
