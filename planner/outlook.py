"""Tells how much looks would tell: views of the carried camera, and covers that can be lifted, in nats."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dsr.believing.distribution import Alternative, Whereabouts
from dsr.math3d.transforms import Array, Pose, position_deviation
from dsr.memory import Memory
from dsr.visibility import Body, Perspective, VisibleScene, body_at, intrinsics_of, is_seen, read_perspectives
from dsr.visibility.bodies import read_posed
from dsr.visibility.perspectives import PERSON
from dsr.vocabulary.relations import MODELLED, SURFACES, THINGS, Relations
from planner.config import PlannerConfig
from planner.grounding import within_reach
from planner.state import WorldState

DOWN = (1.0, 0.0, 0.0, 0.0)
"""world_from_camera of a camera that looks straight down"""
_WIDTH = 96
"""px, of the pictures that are drawn: a cube of 4 cm is 5 px across at 60 cm"""
_DRAWN = 6
"""Places that are drawn of an alternative which is spread out, so that it is seen in part"""
_MOST_ALTERNATIVES = 8
"""Alternatives of a thing that are drawn: a look is chosen within a tick"""
APART = 0.05
"""m between places that show different things: about the size of what is looked for"""
_HIDING = (*THINGS, *MODELLED, *SURFACES, PERSON, "hand")
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


class Outlooks:
    """What can be done to learn more of where things are, with what each would tell.

    Args:
        memory: the graph, with the things' distributions.
        state: the believed state of the world.
        camera: name of the camera that an arm carries; empty for none.
        config: heights and margins.
    """

    def __init__(self, memory: Memory, state: WorldState, camera: str, config: PlannerConfig) -> None:
        self._memory, self._state, self._config, self._camera = memory, state, config, camera
        posed = [one for one in read_posed(memory) if one.kind in _HIDING]
        self._scene = VisibleScene.of(memory, posed)

    def best(self, things: Collection[str], done: Collection[Look], kept: Collection[str] = ()) -> Look | None:
        """The look that tells most about where `things` are; None if none tells as much as `least_information`.

        What is `done` already is not done again, and no cover is lifted that is `kept` where it is. Of looks that tell
        as much, the first one is taken: a view before a cover, since that takes less time.
        """
        wheres = [where for name in sorted(things) if (where := self._memory.belief(name)) is not None]
        views = [view for view in self._views(wheres) if not any(_is_near(view, one.view) for one in done)]
        kept = {*kept, *(one.cover for one in done)}
        covers = [name for name in self._covers(wheres) if name not in kept]
        told = self._told(wheres, views).tolist()
        looks = [Look(information, view) for information, view in zip(told, views, strict=True)]
        looks += [Look(self._told_without(wheres, cover), cover=cover) for cover in covers]
        best = max(looks, key=lambda look: round(look.information, 2), default=None)
        return best if best is not None and best.information >= self._config.least_information else None

    def _views(self, wheres: Iterable[Whereabouts]) -> list[Pose]:
        """world_from_camera above each place where one of these things may be, as far as an arm gets there."""
        table = self._state.solids.get(self._state.table or "")
        if table is None or not self._camera:
            return []
        likely = [one for where in wheres for one in where.alternatives[:_MOST_ALTERNATIVES]]
        poses = [one.pose for one in likely if one.pose is not None]
        places = np.array([pose.t[:2] for pose in poses]).reshape(-1, 2)
        height = table.pose.t[2] + self._config.look_height
        found: list[Pose] = []
        for x, y in places[within_reach(places, self._state, self._config)].tolist():
            view = Pose((x, y, height), DOWN)
            if not any(_is_near(view, other) for other in found):
                found.append(view)
        return found

    def _covers(self, wheres: Iterable[Whereabouts]) -> list[str]:
        """Names of what one of these things may be in, and what an arm can lift because nothing is on it."""
        names = {name for where in wheres for one in where.alternatives for name in one.containers}
        return sorted(name for name in names & self._state.graspable if _is_clear(name, self._state.relations))

    def _told(self, wheres: Sequence[Whereabouts], views: Sequence[Pose]) -> Array:
        """(views,) nats"""
        if not views:
            return np.zeros(0)
        return sum((self._information(where, self._seen(where, self._above(views), self._scene.bodies))
                    for where in wheres), np.zeros(len(views)))  # fmt: skip

    def _told_without(self, wheres: Sequence[Whereabouts], cover: str) -> float:
        """Nats that are told more once the cover is elsewhere, by the cameras that stand still and by one above.

        What these see with the cover where it is counts for nothing: so a vessel that is open at its top tells nothing.
        """
        still = {view.name for view in self._state.views}
        eyes = [eye for eye in read_perspectives(self._memory, width=_WIDTH) if eye.name in still]
        if self._camera:
            eyes += self._above(self._views(wheres))
        if not eyes:
            return 0.0
        bodies = self._scene.bodies
        without = [body for body in bodies if body.name != cover]
        told = 0.0
        for where in wheres:
            shown = [self._seen(where, eyes, some).max(axis=0) for some in (without, bodies)]
            more, before = self._information(where, np.array(shown)).tolist()
            told += more - before
        return told

    def _information(self, where: Whereabouts, seen: Array) -> Array:
        """(k,) nats that looks tell about where a thing is, by what they see of its places."""
        return expected_information(np.array([weight for weight, _ in _places(where)]), seen)

    def _above(self, views: Iterable[Pose]) -> list[Perspective]:
        """The carried camera at each of these places."""
        lens = intrinsics_of(self._memory.node(self._camera), _WIDTH)
        return [Perspective(self._camera, view, lens) for view in views]

    def _seen(self, where: Whereabouts, eyes: Sequence[Perspective], bodies: Sequence[Body]) -> Array:
        """(eyes, places) 1 where an eye sees the thing if it is at a place of `_places`, else 0."""
        places = _places(where)
        found = np.zeros((len(eyes), len(places)))
        node = self._memory.node(where.name)
        others = [body for body in bodies if body.name != where.name]
        there = [None if pose is None else body_at(self._memory, node, pose) for _, pose in places]
        for row, eye in enumerate(eyes):
            picture = VisibleScene(others, frozenset()).seen_from(eye)
            found[row] = [body is not None and is_seen(picture.would_show(body)) for body in there]
        return found


def _places(where: Whereabouts) -> list[tuple[float, Pose | None]]:
    """Places where a thing may be, with their probabilities; some of each alternative that is spread out."""
    found: list[tuple[float, Pose | None]] = []
    for one in where.alternatives[:_MOST_ALTERNATIVES]:
        if one.pose is None or position_deviation(one.pose) < APART / 2.0:
            found.append((one.weight, one.pose))
            continue
        alone = Whereabouts(where.name, (Alternative(weight=1.0, pose=one.pose),))
        found += [(one.weight / _DRAWN, pose) for pose in alone.samples(_DRAWN, seed=0)]
    total = sum(weight for weight, _ in found)
    return [(weight / total, pose) for weight, pose in found]


def _is_clear(name: str, relations: Relations) -> bool:
    return name not in relations.held and all(support != name for _, support in relations.on)


def _is_near(view: Pose, other: Pose | None) -> bool:
    """Whether two views show nearly the same."""
    return other is not None and view.distance(other)[0] < APART
