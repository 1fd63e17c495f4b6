"""Start values in closed form: which views agree with the moves of the hand, and where camera and target are.

F. Park and B. Martin, "Robot Sensor Calibration: Solving AX = XB on the Euclidean Group", T-RA 1994, on three views at
a time (Fischler and Bolles' consensus, 1981): single wrong views, mirrored poses of flat targets (two in each view) and
targets that look alike when turned do no harm. The unit of the hand's poses is found as well.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.calibrator.hand_eye.observations import Observations
from dsr.errors import ConfigError
from dsr.math3d import batches
from dsr.math3d.batches import inverses, rotvecs
from dsr.math3d.transforms import Array
from dsr.vocabulary.intrinsics import Intrinsics

_TRIPLES = 60
"""Of views that are tried: with a third of the views wrong, 99.99 % that one is right"""
_FEW = 12
"""Views up to which each triple is written down"""
_CHOICES = 2
"""Poses of the target that are tried in each view of a triple, of those whose angles agree best"""
_MOST_POINTS = 16
"""Points of each view by which a start is judged"""
_CAP = 0.25
"""Error over the target's apparent size from which a view does not agree at all"""
_LEAST_TURN = 0.03
"""rad, of moves that tell about a mount"""
_FLAT = 1e-9
"""m^2, variance of points off a plane"""
_ROUNDS = 4
_AS_GOOD = 2.0
"""Error with equal units over that with the best ratio of them, up to which units are equal"""


class StartGuess(NamedTuple):
    """A guess to start from."""

    mount: Array
    """(4, 4) carrier_from_camera"""
    target: Array
    """(4, 4) holder_from_target"""
    orders: tuple[int, ...]
    """(v) numbers of the symmetry in which each view shows the points"""
    scale: float
    """Lengths of the hand's poses over those that the images show; 1 if the units are right"""
    agreeing: NDArray[np.bool_]
    """(v,) which views agree with it"""


def target_poses(observations: Observations, intrinsics: Intrinsics) -> list[Array]:
    """Of each view, (k, 4, 4) camera_from_target: the poses from which the points look as they do, but symmetries.

    Raises:
        ConfigError: for a view of which no pose can be found: names it.
    """
    found = []
    for name, pixels, seen in zip(observations.names, observations.pixels, observations.seen, strict=True):
        points, rays = observations.points[seen], intrinsics.rays(pixels[seen])
        usable = np.isfinite(rays).all(axis=1)
        poses = _perspective(points[usable], rays[usable, :2])
        if not len(poses):
            raise ConfigError(f"{name}: no pose of the target looks like that; check the target and the intrinsics")
        found.append(poses)
    return found


def _perspective(points: Array, rays: Array) -> Array:
    if len(points) < 4:
        return np.empty((0, 4, 4))
    is_flat = float(np.linalg.eigvalsh(np.cov(points.T))[0]) < _FLAT
    method = cv2.SOLVEPNP_IPPE if is_flat else cv2.SOLVEPNP_SQPNP
    frame, flat = _flattened(points) if is_flat else (np.eye(4), points)
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            np.ascontiguousarray(flat), np.ascontiguousarray(rays), np.eye(3), None, flags=method
        )
    except cv2.error:
        return np.empty((0, 4, 4))
    poses = []
    for turn, shift in zip(turns, shifts, strict=True):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], np.ravel(shift)
        if np.isfinite(pose).all() and pose[2, 3] > 0.0:
            poses.append(pose @ frame)
    return np.array(poses).reshape(-1, 4, 4)


def _flattened(points: Array) -> tuple[Array, Array]:
    """plane_from_target (4, 4) and the points (n, 3) there, with z = 0: OpenCV's IPPE asks for that."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle)[2]
    axes[2] = np.cross(axes[0], axes[1])
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = axes, -axes @ middle
    flat = (points - middle) @ axes.T
    flat[:, 2] = 0.0
    return frame, flat


def find_start(observations: Observations, intrinsics: Intrinsics, seed: int) -> StartGuess:
    """The guess with which most views agree.

    Args:
        observations: three views or more, with turns about two axes.
        intrinsics: of the camera, roughly.
        seed: draws the triples of views, where there are many.

    Raises:
        ConfigError: if a view shows no pose of the target, or none of the guesses explains half of the views.
    """
    judge = _Judge(observations, intrinsics)
    poses = _with_symmetries(observations, target_poses(observations, intrinsics))
    triples = _triples(len(observations), seed)
    guesses = [guess for triple in triples for guess in _of_triple(observations, poses, triple)]
    if not guesses:
        raise ConfigError("the hand hardly turns between the views: turn it by 20 to 40 degrees, about different axes")
    best = min((judge.judged(*guess) for guess in guesses), key=lambda one: one.cost)
    for _ in range(_ROUNDS):
        better = _again(observations, judge, poses, best)
        if better is None or better.cost >= best.cost:
            break
        best = better
    usual = _again(observations, judge, poses, best, 1.0)
    if usual is not None and usual.cost < _AS_GOOD * best.cost:  # the scale is little known where views are few or bad
        best = usual
    if 2 * int(best.agreeing.sum()) <= len(observations):
        raise ConfigError(
            f"no mount of the camera explains the images: at best {int(best.agreeing.sum())} of {len(observations)} "
            "views agree; check that each pose belongs to its image, that it is the pose of the hand in the base "
            "(not its inverse), the order x y z w of quaternions, that joints are in rad, and --eye-to-hand"
        )
    return StartGuess(best.mount, best.target, best.orders, best.scale, best.agreeing)


def _again(
    observations: Observations, judge: _Judge, poses: list[Array], guess: _Judged, scale: float | None = None
) -> _Judged | None:
    """The guess from all views that agree with one; None if these are too few."""
    rows = np.flatnonzero(guess.agreeing)
    if len(rows) < 3:
        return None
    chosen = np.array([judge.nearest(poses[row], guess, row) for row in rows.tolist()])
    solved = _solved(observations.holders[rows], chosen, scale)
    return None if solved is None else judge.judged(*solved)


def _with_symmetries(observations: Observations, poses: list[Array]) -> list[Array]:
    """Poses of each view as (k, 4, 4), those of all symmetries one after the other."""
    changes = [_symmetry(observations.points, order) for order in observations.symmetries]
    return [np.concatenate([view @ change for change in changes]) for view in poses]


def _symmetry(points: Array, order: NDArray[np.intp]) -> Array:
    """(4, 4) the motion of the target that brings its points to where those in another order are."""
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = batches.rigid_fit(points[order], points)
    return np.asarray(np.linalg.inv(motion))


def _triples(count: int, seed: int) -> list[tuple[int, ...]]:
    every: list[tuple[int, ...]] = list(itertools.combinations(range(count), 3)) if count <= _FEW else []
    rng = np.random.default_rng(seed)
    if not every:
        return [tuple(rng.choice(count, 3, replace=False).tolist()) for _ in range(_TRIPLES)]
    if len(every) <= _TRIPLES:
        return every
    return [every[index] for index in rng.choice(len(every), _TRIPLES, replace=False)]


def _of_triple(
    observations: Observations, poses: list[Array], triple: tuple[int, ...]
) -> list[tuple[Array, Array, float]]:
    """Guesses from three views: of the poses of the target in each, those whose angles agree with the hand's."""
    first, *others = triple
    holders = observations.holders
    found = []
    for start in poses[first][: len(poses[first]) // len(observations.symmetries)]:
        choices = []
        for row in others:
            wanted = _angle(holders[row] @ np.linalg.inv(holders[first]))
            off = [abs(_angle(np.linalg.inv(pose) @ start) - wanted) for pose in poses[row]]
            choices.append(poses[row][np.argsort(off)[:_CHOICES]])
        for pair in itertools.product(*choices):
            guess = _solved(holders[list(triple)], np.array([start, *pair]))
            if guess is not None:
                found.append(guess)
    return found


def _angle(transform: Array) -> float:
    return math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(transform[:3, :3])) - 1.0))))


def _solved(holders: Array, poses: Array, scale: float | None = None) -> tuple[Array, Array, float] | None:
    """Mount, target and scale by which carrier_from_holder (v, 4, 4) fit camera_from_target (v, 4, 4), in closed form.

    None if the moves have one axis only. The scale is found unless it is given. With mount X and target Z, what is
    solved is X camera_from_target = carrier_from_holder Z.
    """
    left, right = [], []
    for one, other in itertools.combinations(range(len(poses)), 2):
        left.append(holders[one][:3, :3] @ holders[other][:3, :3].T)
        right.append(poses[one][:3, :3] @ poses[other][:3, :3].T)
    moves, seen = rotvecs(np.array(left)), rotvecs(np.array(right))
    spread = np.linalg.svd(moves, compute_uv=False)
    if spread[1] < _LEAST_TURN:
        return None
    mount, target = np.eye(4), np.eye(4)
    u, _, vt = np.linalg.svd(moves.T @ seen)
    mount[:3, :3] = u @ np.diag((1.0, 1.0, np.linalg.det(u @ vt))) @ vt
    turned = np.swapaxes(holders[:, :3, :3], 1, 2) @ mount[:3, :3] @ poses[:, :3, :3]
    u, _, vt = np.linalg.svd(turned.sum(axis=0))
    target[:3, :3] = u @ np.diag((1.0, 1.0, np.linalg.det(u @ vt))) @ vt
    # R_X t_C s + t_X - R_H t_Z = t_H, with the scale s
    unit = np.broadcast_to(np.eye(3), (len(poses), 3, 3))
    rows = np.concatenate([unit, -holders[:, :3, :3], mount[:3, :3] @ poses[:, :3, 3:]], axis=2)
    rows, wanted = rows.reshape(-1, 7), holders[:, :3, 3].ravel()
    if scale is not None:
        rows, wanted = rows[:, :6], wanted - scale * rows[:, 6]
    answer = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    mount[:3, 3], target[:3, 3] = answer[:3], answer[3:6]
    found = float(answer[6]) if scale is None else scale
    return (mount, target, found) if found > 0.0 else None


class _Judged(NamedTuple):
    mount: Array
    target: Array
    scale: float
    cost: float
    orders: tuple[int, ...]
    agreeing: NDArray[np.bool_]


class _Judge:
    """Tells how well guesses explain the images."""

    def __init__(self, observations: Observations, intrinsics: Intrinsics) -> None:
        self._observations, self._intrinsics = observations, intrinsics
        count = observations.pixels.shape[1]
        self._points = np.unique(np.linspace(0, count - 1, min(count, _MOST_POINTS)).round().astype(np.intp))
        self._shown = np.stack([observations.pixels[:, order] for order in observations.symmetries], axis=1)
        spans = np.nanmax(observations.pixels, axis=1) - np.nanmin(observations.pixels, axis=1)
        self._sizes = np.linalg.norm(spans, axis=1)
        if count > _MOST_POINTS and bool(observations.seen.all()):
            self._shown = self._shown[:, :, self._points]
        else:
            self._points = np.arange(count)

    def judged(self, mount: Array, target: Array, scale: float) -> _Judged:
        """A guess with its cost, and which views agree in which order of the points."""
        poses = self._predicted(mount, target, scale)
        points = self._observations.points[self._points]
        before = np.einsum("vij,nj->vni", poses[:, :3, :3], points) + poses[:, None, :3, 3]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            pixels = self._intrinsics.project(np.where(before[..., 2:] > 0.0, before, np.nan))
            off = np.linalg.norm(self._shown - pixels[:, None], axis=3)  # (v, s, n)
        off = np.where(np.isnan(off) & np.isfinite(self._shown).all(axis=3), np.inf, off)
        with np.errstate(invalid="ignore"):
            mean = np.nanmean(off, axis=2) / self._sizes[:, None]
        orders = mean.argmin(axis=1)
        best = mean.min(axis=1)
        cost = float(np.minimum(best, _CAP).sum())
        return _Judged(mount, target, scale, cost, tuple(orders.tolist()), best < _CAP)

    def nearest(self, poses: Array, guess: _Judged, row: int) -> Array:
        """Of the poses (k, 4, 4) that a view allows, the one that is nearest in rotation to what a guess predicts."""
        predicted = self._predicted(guess.mount, guess.target, guess.scale)[row]
        alike = np.einsum("kij,ij->k", poses[:, :3, :3], predicted[:3, :3])
        return np.asarray(poses[int(alike.argmax())])

    def _predicted(self, mount: Array, target: Array, scale: float) -> Array:
        """(v, 4, 4) camera_from_target in the unit of the target."""
        poses = inverses(mount) @ self._observations.holders @ target
        poses[:, :3, 3] /= scale
        return np.asarray(poses)
