"""Tells how much looks would tell: views of the carried camera, and covers that can be lifted, in nats."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from dsr.believing.distribution import Whereabouts
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.visibility import Body, Perspective, VisibleScene, body_at, intrinsics_of, is_seen, read_perspectives
from dsr.visibility.bodies import read_posed
from dsr.visibility.perspectives import PERSON
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.relations import MODELLED, SURFACES, THINGS
from dsr.vocabulary.what_if import USUAL_WORLDS
from planner.carried import CarriedCamera
from planner.config import PlannerConfig
from planner.grounding import within_reach
from planner.likely_places import APART, likely_places
from planner.state import WorldState

T = TypeVar("T")
DOWN = (1.0, 0.0, 0.0, 0.0)
"""world_from_camera of a camera that looks straight down"""
WIDTH = 96
"""px, of the pictures that are drawn: a cube of 4 cm is 5 px across at 60 cm"""
_DRAWN_AT_ONCE = 100
"""Bodies that are drawn in one step: about 20 ms, so that a planner of 10 Hz has time for all else"""
HIDING = (*THINGS, *MODELLED, *SURFACES, PERSON, "hand")
"""Node types of what hides things from a camera. Arms do not count: they will be elsewhere."""


@dataclass(frozen=True)
class Look:
    """Something to be done in order to see more."""

    information: float
    """nats expected from it"""
    view: Pose | None = None
    """world_from_camera to look from; None if a cover is lifted instead"""
    cover: str = ""
    """Name of the thing to be lifted off"""
    eye: CarriedCamera | None = None
    """The camera that looks"""

    def __str__(self) -> str:
        if self.view is None:
            return f"lift {self.cover}"
        x, y, _ = self.view.t
        return f"look from above x {x:.2f} m, y {y:.2f} m"


def expected_information(weights: Array, seen: Array) -> Array:
    """(k,) nats that each of k looks is expected to tell about which of n alternatives is so.

    A look shows a thing where it is, or shows that it is nowhere in sight. So this is the mutual information of the
    alternative and of what is seen (Cover and Thomas, Elements of Information Theory, eq. 2.36).

    Args:
        weights: (n,) probabilities of the alternatives, which sum to 1.
        seen: (k, n) probability that a look shows the thing if an alternative is so.
    """
    unseen = weights * (1.0 - seen)
    in_vain = unseen.sum(axis=1, keepdims=True)
    left = unseen / np.where(in_vain > 0.0, in_vain, 1.0)
    information: Array = _entropy(weights[None, :]) - in_vain[:, 0] * _entropy(left)
    return information


def _entropy(weights: Array) -> Array:
    """(k,) nats of k distributions (k, n)."""
    found: Array = -np.sum(weights * np.log(np.where(weights > 0.0, weights, 1.0)), axis=1)
    return found


class _Sought(NamedTuple):
    """A thing that is looked for."""

    where: Whereabouts
    weights: Array
    """(n,) probabilities of the places where it may be, which sum to 1"""
    there: list[Body | None]
    """What would be seen at each of these places; None for what is gone"""

    def information(self, seen: Array) -> Array:
        """(k,) nats that k looks tell about where it is, by what they show of its places, (k, n)."""
        return expected_information(self.weights, seen)


Working = Generator[None, None, T]
"""Ends with its result, after a bounded part of the work at each step."""


class Outlooks:
    """What can be done to learn more of where things are, with what each would tell.

    All is as it was when this was made, however long the choice takes.

    Args:
        memory: the graph, with the things' distributions.
        state: the believed state of the world.
        eyes: the cameras that arms can bring somewhere.
        things: names of what is looked for.
        config: heights and margins.
    """

    def __init__(
        self, memory: Memory, state: WorldState, eyes: Sequence[CarriedCamera], things: Collection[str],
        config: PlannerConfig,
    ) -> None:  # fmt: skip
        self._state, self._config = state, config
        self._bodies = VisibleScene.of(memory, [one for one in read_posed(memory) if one.kind in HIDING]).bodies
        self._sought = [found for name in sorted(things) if (found := _sought(memory, name)) is not None]
        lenses = [(eye, intrinsics_of(memory.node(eye.name), WIDTH)) for eye in eyes]
        self._views = [view for eye, lens in lenses for view in self._views_of(eye, lens)]
        still = {view.name for view in state.views}
        self._still = [eye for eye in read_perspectives(memory, width=WIDTH) if eye.name in still]
        self._drawn = 0
        self._known: dict[tuple[str, Perspective], Array] = {}

    def best(self, done: Collection[Look], kept: Collection[str] = ()) -> Working[Look | None]:
        """The look that tells most about where the things are; None if none tells as much as `least_information`.

        What is `done` already is not done again, and no cover is lifted that is `kept` where it is. Of looks that tell
        as much, the first one is taken: a view before a cover, since that takes less time. It takes a step for each
        `_DRAWN_AT_ONCE` bodies that are drawn.
        """
        looks = []
        for eye, view in self._views:
            if not any(_is_near(view.world_from_view, one.view) for one in done):
                told = yield from self._told(view)
                looks.append(Look(told, view.world_from_view, eye=eye))
        for cover in self._covers():
            if cover not in {*kept, *(one.cover for one in done)}:
                told = yield from self._told_without(cover)
                looks.append(Look(told, cover=cover))
        best = max(looks, key=lambda look: round(look.information, 2), default=None)
        return best if best is not None and best.information >= self._config.least_information else None

    def _views_of(self, eye: CarriedCamera, lens: Intrinsics) -> Iterator[tuple[CarriedCamera, Perspective]]:
        """Above each place where one of the things may be, as far as the arm gets there."""
        table = self._state.solids.get(self._state.table or "")
        if table is None:
            return
        likely = [one for sought in self._sought for one in sought.where.alternatives[:USUAL_WORLDS]]
        poses = [one.pose for one in likely if one.pose is not None]
        places = np.array([pose.t[:2] for pose in poses]).reshape(-1, 2)
        height = table.pose.t[2] + self._config.look_height
        found: list[Pose] = []
        for x, y in places[within_reach(places, self._state, self._config, eye.arm)].tolist():
            view = Pose((x, y, height), DOWN)
            if not any(_is_near(view, other) for other in found):
                found.append(view)
                yield eye, Perspective(eye.name, view, lens)

    def _covers(self) -> list[str]:
        """Names of what one of the things may be in, and what an arm can lift because nothing is on it."""
        names = {name for sought in self._sought for one in sought.where.alternatives for name in one.containers}
        return sorted(name for name in names if can_be_lifted(name, self._state, self._config))

    def _told(self, view: Perspective) -> Working[float]:
        """Nats that a view tells."""
        told = 0.0
        for sought in self._sought:
            seen = yield from self._seen(sought, view)
            told += float(sought.information(seen[None])[0])
        return told

    def _told_without(self, cover: str) -> Working[float]:
        """Nats that are told more once the cover is elsewhere, by the cameras that stand still and by one above.

        What these see with the cover where it is counts for nothing: so a vessel that is open at its top tells nothing.
        """
        eyes = [*self._still, *(view for _, view in self._views)]
        told = 0.0
        for sought in self._sought if eyes else ():
            shown = np.zeros((2, len(sought.weights)))
            for eye in eyes:
                for row, without in enumerate((cover, "")):
                    seen = yield from self._seen(sought, eye, without)
                    shown[row] = np.maximum(shown[row], seen)
            more, before = sought.information(shown).tolist()
            told += more - before
        return told

    def _seen(self, sought: _Sought, eye: Perspective, without: str = "") -> Working[Array]:
        """(places,) 1 where an eye sees the thing if it is there, else 0; with a cover, by name, elsewhere."""
        key = (sought.where.name, eye)
        if not without and key in self._known:
            return self._known[key]
        hiding = [body for body in self._bodies if body.name not in (sought.where.name, without)]
        picture = VisibleScene(hiding, frozenset()).seen_from(eye)
        self._drawn += len(hiding)
        seen = np.zeros(len(sought.there))
        for place, body in enumerate(sought.there):
            if body is not None:
                seen[place] = is_seen(picture.would_show(body))
                self._drawn += 1
            if self._drawn >= _DRAWN_AT_ONCE:
                self._drawn = 0
                yield
        if not without:
            self._known[key] = seen
        return seen


def _sought(memory: Memory, name: str) -> _Sought | None:
    where, node = memory.belief(name), memory.get_node(name)
    if where is None or node is None:
        return None
    places = likely_places(where, by_turn=node.get("marker_id") is not None)
    there = [None if one.pose is None else body_at(memory, node, one.pose) for one in places]
    return _Sought(where, np.array([one.probability for one in places]), there)


def can_be_lifted(name: str, state: WorldState, config: PlannerConfig) -> bool:
    """Whether an arm can lift a thing: it fits between the fingers, nothing is on it, and an arm gets there."""
    relations = state.relations
    if name not in state.graspable or name in relations.held or any(support == name for _, support in relations.on):
        return False
    return bool(within_reach(np.array([state.solids[name].pose.t[:2]]), state, config)[0])


def _is_near(view: Pose, other: Pose | None) -> bool:
    """Whether two views show nearly the same."""
    return other is not None and view.distance(other)[0] < APART
