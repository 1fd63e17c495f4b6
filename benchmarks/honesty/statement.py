"""What somebody says of a thing's place, as a distribution, and how well that foretells the truth.

The outcome is that a thing is *gone*, or its pose. A pose is measured in m^3 (position), or in m^3 rad^3 (pose: the
invariant volume of SE(3)). What a statement leaves open is spread by indifference: half on *gone*, half evenly over the
workspace. Each statement is then completed by a small `DOUBT` of that kind. So no score is infinite: one error
costs as much as the workspace is large, not as far as it is off.

A completed statement is scored by minus the logarithm of its density at the truth, in nats: less is better. To say
what one believes costs at most -log(1 - DOUBT) nats more, on average, than the best lie would.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from agents.scenario.generate.validity import WORKSPACE
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

DOUBT = 0.001
"""Share of any statement that is kept for what it rules out: a tenth of the share beyond a 99 % region"""
VOLUME = 4 * WORKSPACE[0] * WORKSPACE[1] * WORKSPACE[2]
"""m^3, in which valid episodes take place"""
TURNS = 8 * math.pi**2
"""rad^3, volume of all rotations, where that of small ones is the volume of their rotation vectors"""
GONE = 0.5
"""Share of indifference that is for a thing to be gone: as likely as not"""
RESOLUTION = 1e-4, 1e-3
"""m and rad, added to all standard deviations, in squares: the grain of truth, which comes 20 times a second"""
_DRAWS = 4000
"""Draws from a statement of several poses, by which regions are found: 90 % is known to 0.5 %"""
_SMALL = 1e-3
"""rad, below which series replace quotients of small numbers"""


class Likely(NamedTuple):
    """One pose that a thing may have."""

    weight: float
    """Probability of it."""
    pose: Pose
    """world_from_object, with a covariance"""


class Statement(NamedTuple):
    """What is said of a thing: poses with weights, and how likely it is gone. The rest of 1 is left open."""

    poses: tuple[Likely, ...] = ()
    gone: float = 0.0
    """Probability that it is not in the scene."""

    @property
    def open(self) -> float:
        """The share about which nothing is said."""
        return max(0.0, 1.0 - self.gone - sum(likely.weight for likely in self.poses))


def stated(pose: Pose | None, *, gone: bool = False) -> Statement:
    """One pose, or that it is gone, or nothing.

    A pose without a covariance says nothing that could be foretold by: its covariance is *unknown*, not zero.
    """
    if gone:
        return Statement((), 1.0)
    return Statement() if pose is None or pose.cov is None else Statement((Likely(1.0, pose),))


def log_score(statement: Statement, truth: Pose | None, *, turned: bool = False) -> float:
    """Minus the log density of the completed statement at the truth, nats.

    Args:
        statement: what is said.
        truth: world_from_object; None: the thing is gone.
        turned: score the whole pose; else the position.
    """
    if truth is None:
        said, indifferent = statement.gone, GONE
    else:
        said = float(_said(statement.poses, _only(truth), turned=turned)[0])
        indifferent = (1.0 - GONE) / (VOLUME * (TURNS if turned else 1.0))
    said += statement.open * indifferent
    return -math.log((1.0 - DOUBT) * said + DOUBT * indifferent)


def region_of(statement: Statement, truth: Pose | None, *, turned: bool = False) -> float | None:
    """The mass of the smallest region of highest density that holds the truth; None of one that leaves all open.

    A region of 90 % holds the truth if this is at most 0.9. *Gone* belongs to every region where it is more likely
    than not, else to none but the whole.
    """
    return _region_of(statement, truth, lambda place: _mass_above(statement, place, turned=turned))


def sideways_region_of(statement: Statement, truth: Pose | None) -> float | None:
    """As `region_of`, of the horizontal position alone.

    A support tells heights exactly, and truth has no grain there. So regions of all three dimensions hold the truth
    more often than an honest statement says: regions of 90 % in 95.6 %.
    """
    return _region_of(statement, truth, lambda place: _mass_above_sideways(statement, place))


def _region_of(statement: Statement, truth: Pose | None, above: Callable[[Pose], float]) -> float | None:
    """The mass of the region that holds the truth, by the mass of all poses that are likelier than a true one."""
    if statement.open >= 1.0:
        return None
    first = statement.gone if statement.gone > 0.5 else 0.0
    if truth is None:
        return 0.0 if first else 1.0
    return min(1.0, first + above(truth)) if statement.poses else 1.0


def mass_near(statement: Statement, place: Vector3, reach: float) -> float:
    """The probability that a thing is within `reach` (m) of a place (m, world), by draws from the statement."""

    def near(likely: Likely, count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
        drawn = _drawn(likely.pose, count, rng, turned=False)
        return np.asarray(np.linalg.norm(drawn.places - np.array(place), axis=1) <= reach)

    return _share_of_draws(statement, near)


class _Poses(NamedTuple):
    """Many poses, world_from_object."""

    places: Array
    """(n, 3) m"""
    turns: Rotation
    """n rotations"""


def _only(pose: Pose) -> _Poses:
    return _Poses(pose.translation[None], Rotation.from_quat(pose.rotation[None]))


def _said(poses: tuple[Likely, ...], at: _Poses, *, turned: bool) -> Array:
    """(n,) density of what is said at some poses, by the invariant volume (m^3, or m^3 rad^3)."""
    densities = [likely.weight * _densities(likely.pose, at, turned=turned) for likely in poses]
    return np.sum(densities, axis=0) if densities else np.zeros(len(at.places))


def _densities(mean: Pose, at: _Poses, *, turned: bool) -> Array:
    """(n,) of a Gaussian in the tangent at the mean."""
    offsets = _offsets(mean, at, turned=turned)
    size = offsets.shape[1]
    _, determinant = np.linalg.slogdet(_covariance(mean, turned=turned))
    logarithms = -0.5 * (_distances2(mean, offsets, turned=turned) + determinant + size * math.log(2 * math.pi))
    if turned:
        logarithms -= 2.0 * np.log(np.sinc(np.linalg.norm(offsets[:, 3:], axis=1) / (2 * math.pi)) ** 2)
    return np.asarray(np.exp(logarithms))


def _distances2(mean: Pose, offsets: Array, *, turned: bool) -> Array:
    """(n,) squared Mahalanobis distances."""
    return np.asarray((offsets.T * np.linalg.solve(_covariance(mean, turned=turned), offsets.T)).sum(axis=0))


def _offsets(mean: Pose, at: _Poses, *, turned: bool) -> Array:
    """(n, 6) twists, or (n, 3) positions, from the mean to some poses in the frame of the mean: m, rad."""
    places = (at.places - mean.translation) @ mean.rotation_matrix
    if not turned:
        return np.asarray(places)
    phi = (Rotation.from_quat(mean.rotation).inv() * at.turns).as_rotvec()
    angle = np.linalg.norm(phi, axis=1)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    series, exact = 1.0 / 12.0 + angle**2 / 720.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2
    bend = np.where(small, series, exact)[:, None]
    rho = places - 0.5 * np.cross(phi, places) + bend * np.cross(phi, np.cross(phi, places))
    return np.column_stack([rho, phi])


def _covariance(mean: Pose, *, turned: bool) -> Array:
    full = np.array(mean.cov).reshape(6, 6) + np.diag([RESOLUTION[0] ** 2] * 3 + [RESOLUTION[1] ** 2] * 3)
    return full if turned else full[:3, :3]


def _mass_above(statement: Statement, truth: Pose, *, turned: bool) -> float:
    """The mass of all places that are more likely than the true one, of several poses by draws."""
    if len(statement.poses) == 1:
        (likely,) = statement.poses
        offsets = _offsets(likely.pose, _only(truth), turned=turned)
        distance2 = _distances2(likely.pose, offsets, turned=turned)[0]
        return likely.weight * float(chi2.cdf(distance2, offsets.shape[1]))
    here = _said(statement.poses, _only(truth), turned=turned)[0]

    def likelier(likely: Likely, count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
        drawn = _drawn(likely.pose, count, rng, turned=turned)
        return np.asarray(_said(statement.poses, drawn, turned=turned) > here)

    return _share_of_draws(statement, likelier)


def _share_of_draws(
    statement: Statement, holds: Callable[[Likely, int, np.random.Generator], NDArray[np.bool_]]
) -> float:
    """The mass of the places of which something holds, told for so many draws from each pose of a statement."""
    rng, total, found = np.random.default_rng(0), sum(likely.weight for likely in statement.poses), 0.0
    for likely in statement.poses:
        found += likely.weight * float(np.mean(holds(likely, max(1, round(_DRAWS * likely.weight / total)), rng)))
    return found


def _mass_above_sideways(statement: Statement, truth: Pose) -> float:
    """The mass of all horizontal positions that are more likely than the true one, of several poses by draws."""
    weights = np.array([likely.weight for likely in statement.poses])
    means = np.array([likely.pose.t[:2] for likely in statement.poses])
    spreads = np.array([_sideways(likely.pose) for likely in statement.poses])
    inverses, sizes = np.linalg.inv(spreads), np.sqrt(np.linalg.det(spreads))

    def distances2(places: Array) -> Array:
        """(n, m), squared Mahalanobis distances of n places from m poses."""
        off = places[:, None] - means
        return np.asarray(np.einsum("nmi,mij,nmj->nm", off, inverses, off))

    def densities(places: Array) -> Array:
        """(n,), up to a factor."""
        return np.asarray(np.exp(-0.5 * distances2(places)) @ (weights / sizes))

    there = np.array([truth.t[:2]])
    if len(weights) == 1:
        return float(weights[0] * chi2.cdf(distances2(there)[0, 0], 2))
    here = densities(there)[0]

    def likelier(likely: Likely, count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
        root = np.linalg.cholesky(_sideways(likely.pose))
        return np.asarray(densities(likely.pose.t[:2] + rng.standard_normal((count, 2)) @ root.T) > here)

    return _share_of_draws(statement, likelier)


def _sideways(pose: Pose) -> Array:
    """(2, 2) m^2, world: covariance of the horizontal position, with the grain of truth."""
    return np.asarray(pose.parent_covariances()[0][:2, :2] + RESOLUTION[0] ** 2 * np.eye(2))


def _drawn(mean: Pose, count: int, rng: np.random.Generator, *, turned: bool) -> _Poses:
    """So many poses of a Gaussian in the tangent at the mean; positions alone are Gaussian, too: to first order."""
    twists = rng.standard_normal((count, 6)) @ np.linalg.cholesky(_covariance(mean, turned=True)).T
    rho, phi = twists[:, :3], twists[:, 3:]
    if turned:
        angle = np.maximum(np.linalg.norm(phi, axis=1), _SMALL)[:, None]  # of smaller ones the quotients are the same
        once, twice = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
        rho = rho + once * np.cross(phi, rho) + twice * np.cross(phi, np.cross(phi, rho))
    places = mean.translation + rho @ mean.rotation_matrix.T
    return _Poses(places, Rotation.from_quat(mean.rotation) * Rotation.from_rotvec(phi))
