"""Decides whether the camera or the objects moved, by the costs of both in nats, from one view or several."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.calibrator.solve.problem import ObjectSighting, Problem
from agents.calibrator.solve.robust import OUTLIER
from agents.calibrator.solve.solution import CalibrationSolution
from dsr.math3d.transforms import Array, Pose
from dsr.perception.consensus import agree_beyond_chance, tells_rotation
from dsr.perception.scales import BUMP
from dsr.vocabulary import nats

_MOST_LEANING = 8.0  # nats for one object that would lean, though it is not believed to
_NOISE = 3.0  # nats that noise alone may make of that
_CLEARLY = 6.0  # nats between two explanations that make one of them the answer
_TILT, _HEIGHT = 0.0175, 0.005  # rad, m by which objects that are moved on a table may seem to leave it, at least
_SIGMAS = 4.0  # standard deviations, likewise
_BUMPED = BUMP**2 * np.eye(6)
"""m^2, rad^2: how far a bump moves a camera"""


def bumped(before: Pose) -> Pose:
    """Where a camera may be after a bump: about parent_from_camera `before`, with covariance."""
    return before.with_covariance(_BUMPED)


class Decision(NamedTuple):
    """Whether the camera or the objects moved."""

    moved: bool | None
    """Whether the camera moved; None if that cannot be told yet."""
    is_ambiguous: bool
    """Objects that were all moved alike would have looked the same."""
    why: str
    """The reason in words, for people."""
    is_idle: bool = False
    """Everything is seen where it was believed: there is nothing that has to be explained otherwise."""


def decide(
    sightings: Sequence[ObjectSighting],
    before: Pose,
    solution: CalibrationSolution,
    world_from_parent: Pose,
    carried: Collection[str] = (),
) -> Decision:
    """Decide by one view. A camera that moved displaces all that it sees alike; a moved object is displaced by itself.

    Args:
        sightings: of one view.
        before: parent_from_camera as it was believed.
        solution: the calibration by these sightings.
        world_from_parent: in that view.
        carried: objects that are on or in others.
    """
    problem = Problem(sightings)
    squared = problem.squared(before.matrix)
    names = {sighting.name for sighting in sightings}
    here = {sighting.name for sighting, value in zip(sightings, squared, strict=True) if value < OUTLIER}
    agreeing = names - set(solution.outliers)
    explained = np.array([sighting.name in agreeing - here for sighting in sightings])
    by_objects = _moving(names - here, carried) + _leaning(problem, world_from_parent @ before, explained)
    by_objects += _hovering(problem, before, world_from_parent, explained)
    by_camera = nats.CAMERA_MOVED + nats.MOVED * len(names - agreeing)
    by_camera += max(nats.COINCIDENCE, nats.MOVED * len(agreeing)) * len(here - agreeing)
    if 2 * len(agreeing) <= len(names) or by_camera >= by_objects:
        if not here:
            return Decision(
                False, False, f"no motion of the camera explains better what is seen of {len(names)} object(s)"
            )
        why = f"{len(here)} of {len(names)} objects are seen where they are believed to be"
        return Decision(False, False, why, is_idle=here == names)
    if not agree_beyond_chance(told_turns(sightings, agreeing)):
        return Decision(None, False, f"only {len(agreeing)} object(s) tell of the camera, too little to be sure")
    if solution.problem:
        return Decision(None, False, solution.problem)
    if _stays_on_table(alike(before, solution.pose, world_from_parent), problem, solution, world_from_parent):
        return Decision(True, True, "objects that were all moved alike would look the same")
    return Decision(True, False, "objects that were all moved alike would have left the table")


def told_turns(sightings: Sequence[ObjectSighting], names: Collection[str]) -> list[bool]:
    """Of each of these objects whether any sighting tells how it is turned."""
    told = {one.name for one in sightings if tells_rotation(_covariance_of(one)[3:, 3:])}
    return [name in told for name in names]


def _covariance_of(sighting: ObjectSighting) -> Array:
    assert sighting.seen.covariance is not None
    return sighting.seen.covariance


def decide_elsewhere(
    sightings: Sequence[ObjectSighting],
    before: Pose,
    after: Pose,
    moved: Pose,
    parents: Mapping[int, Pose],
    *,
    last: bool,
    carried: Collection[str] = (),
) -> Decision:
    """Decide by views from several places.

    If the camera moved, all beliefs are right; otherwise all objects moved alike.

    Args:
        sightings: of all views, with what was believed before.
        before: parent_from_camera as it was believed.
        after: as it was found.
        moved: world_from_world, the common motion of the objects if it was they that moved.
        parents: world_from_parent by view.
        last: the better explanation is taken, however small its lead.
        carried: objects that are on or in others.
    """
    elsewhere = [
        one._replace(believed=parents[one.view].inverse() @ moved @ parents[one.view] @ one.believed)
        for one in sightings
    ]
    names = {sighting.name for sighting in sightings}
    by_camera = nats.CAMERA_MOVED + _misfit(sightings, after)
    by_objects = _moving(names, carried) + _misfit(elsewhere, before)
    lead = abs(by_camera - by_objects)
    views = len({sighting.view for sighting in sightings})
    if lead < _CLEARLY and not last:
        return Decision(None, True, f"{views} views do not tell yet")
    moved_camera = by_camera < by_objects
    what = "the camera moved" if moved_camera else "all objects were moved alike"
    return Decision(moved_camera, False, f"{views} views tell that {what} (by {lead:.0f} nats)")


def alike(before: Pose, after: Pose, world_from_parent: Pose) -> Pose:
    """world_from_world: the motion of all objects that would look like that of the camera."""
    return world_from_parent @ before @ (world_from_parent @ after).inverse()


def _moving(names: Collection[str], carried: Collection[str]) -> float:
    """Nats: that these were moved."""
    return sum(nats.MOVED_ALONG if name in carried else nats.MOVED for name in names)


def _leaning(problem: Problem, world_from_camera: Pose, explained: NDArray[np.bool_]) -> float:
    """Nats: what was moved was put down on a face. How much those (n,) lean that would not if the camera moved."""
    seen = (world_from_camera.matrix @ problem.seen)[:, :3, :3]
    tilts = np.arccos(np.clip(np.abs(seen[:, 2, :]).max(axis=1), -1.0, 1.0))
    variances = np.diagonal(problem.covariances, axis1=1, axis2=2)[:, 3:].max(axis=1)
    return float(np.clip(0.5 * tilts**2 / variances - _NOISE, 0.0, _MOST_LEANING)[explained].sum())


def _hovering(problem: Problem, before: Pose, world_from_parent: Pose, explained: NDArray[np.bool_]) -> float:
    """Nats: what was moved was put down as high as it was. How much those (n,) hover, which something would hold."""
    seen = (world_from_parent @ before).matrix @ problem.seen
    believed = world_from_parent.matrix @ problem.believed
    ups = seen[:, 2, :3]  # in the frames of the objects, as covariances are
    variances = np.einsum("ni,nij,nj->n", ups, problem.covariances[:, :3, :3], ups) + (_HEIGHT / _SIGMAS) ** 2
    squared = (seen[:, 2, 3] - believed[:, 2, 3]) ** 2 / variances
    return float(np.clip(0.5 * squared - _NOISE, 0.0, nats.HELD)[explained].sum())


def _misfit(sightings: Sequence[ObjectSighting], pose: Pose) -> float:
    """Nats; no sighting counts for more than an outlier does."""
    return 0.5 * float(np.minimum(Problem(sightings).squared(pose.matrix), OUTLIER).sum())


def _stays_on_table(moved: Pose, problem: Problem, solution: CalibrationSolution, world_from_parent: Pose) -> bool:
    """Whether objects that move so neither hover nor sink nor tilt, by more than percepts may be wrong."""
    assert solution.pose.covariance is not None
    turning = float(np.linalg.eigvalsh(solution.pose.covariance[3:, 3:])[-1])
    if math.acos(min(1.0, float(moved.rotation_matrix[2, 2]))) > max(_TILT, _SIGMAS * math.sqrt(turning)):
        return False
    places: Array = (world_from_parent.matrix @ problem.believed)[:, :3, 3]
    noise = math.sqrt(float(np.linalg.eigvalsh(problem.covariances[:, :3, :3])[:, -1].mean()))
    rise = abs(float((moved.apply(places) - places)[:, 2].mean()))
    return rise < max(_HEIGHT, _SIGMAS * noise)
