"""Where an object of known shape is, and how it is turned, from the pixels that show it.

It is taken to stand upright, with the yaw that fits best. If that does not fit, it leans from how it was before, or any
rotation is tried. How well the shape lies on the points then, and how much of it is seen, tell how sure that is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agents.scene_estimator.colored import LEANS, UPRIGHT
from agents.scene_estimator.fitting import BEFORE, NO_SHARE, ROUGH, ROUGH_RAYS, Fit, FrameView, ImagePart, fit, settled
from agents.scene_estimator.leaning import anyhow, is_unlike_fallen, lean, leaning, tilt, turned
from agents.scene_estimator.segmentation import Mask
from agents.scene_estimator.turning import ROUND, nearest_alike, order
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Array

LEAST_SHARE = 0.35
"""Share of an object's image, as it would be with no others before it, that must be seen"""

_WORST_FIT = 0.2  # of the shortest edge: mean distance of the points from the shape, above which it is another thing
_NOISY_FIT = 3.0  # times the depth noise: the same, of thin objects
_AGREEMENT = 0.6  # least share of what should be seen that is seen
_PIXELS_OFF = 0.4  # px, error of the middle of a spot
_FLOOR = 1e-3  # m, likewise, of the model
_PULL = 0.15  # of the object's extent, that the middle may be off for each hidden share
_YAWS = np.radians(np.arange(0.0, 180.0, 30.0))
_FINER = np.radians((10.0, 5.0, 2.5))  # rad, by which the best of those is turned on to both sides
_GOOD_FIT = 1.5  # times the depth noise: a mean distance up to which no other rotation is tried
_USUALLY = 1.4  # times the usual mean distance: the same
_NEWS = 0.1  # weight of the newest in that
_SURELY = 2.0  # times that: the same, for one that leans
_CLEARLY = 0.8  # of the mean distance with which it leans: one with which it surely stands upright
_WELL_SEEN = 0.6  # share of its image, below which another yaw may fit, too, and it leans only if it fits not upright
_ELSEWHERE, _AS_WELL = 0.03, 1.3  # m apart, and times its mean distance: another place at which it fits as well
_STANDS = 0.1  # rad, up to which it is upright again
_TELLS = 0.06  # rad, standard deviation of its tilt up to which it is known to stand upright
_TELLS_LEAN = 0.15  # rad, likewise, to lean: of a ball, whose tilt nothing tells, it is more
_TELLS_YAW = 0.1  # rad, likewise, of its yaw
_SURE_OF_YAW = 0.02  # rad, standard deviation of one that is known best
_TO_COME = 3.0  # times the newest change of a yaw: how far off it may still be
_TRUST = 1.5  # times the mean distance of the points from the shape: how far off the place may be


class Guess(NamedTuple):
    """The rotation of an object in the frame before."""

    yaw: float = 0.0
    """Yaw of the object about the world's vertical, rad."""
    lean: Quaternion = UPRIGHT
    """Rotation in the world, applied after the yaw."""
    misfit: float = math.inf
    """m, usual mean distance of the points from the surface; infinite of what was never placed"""
    followed: bool = False
    """Whether it surely leaned, and in each frame since then it was sure how it is turned."""


class Placed(NamedTuple):
    """The pose of an object as the fit found it."""

    position: Array
    """(3,) m, its centre in the camera frame"""
    covariance: Array
    """(3, 3) m^2, but for the sensor's systematic errors"""
    guess: Guess
    """The rotation that fits best: of use for the next frame"""
    fits: bool
    """Whether the shape lies on the points but for their noise."""
    lean: Quaternion | None
    """Rotation by which the object surely leans, or stands, in the world; None if that cannot be told"""
    yaw_sigma: float
    """rad, standard deviation of the guessed yaw; infinite if that cannot be told"""


def place(
    view: FrameView,
    mask: Mask,
    shape: Shape,
    size: Vector3,
    noise: float,
    guess: Guess,
    *,
    tagged: bool = False,
    search: bool = True,
    may_turn: Callable[[], bool] = lambda: True,
) -> Placed | None:
    """The place of an object, from the pixels of its colour.

    Args:
        view: depth and camera.
        mask: (h, w) those pixels.
        shape: of the object; without parts, a box of `size` m.
        size: edge lengths of its bounding box, m.
        noise: 1/m, standard deviation of the inverse depth of a pixel.
        guess: how it may be turned.
        tagged: whether its upper side (+z) carries a tag, and so not the colour.
        search: try all yaws if that does not fit.
        may_turn: whether all rotations may be tried, which takes long. Nobody asks if a yaw fits.

    Returns:
        None if too little of it is seen, or if what is seen is not its surface.
    """
    scene = ImagePart(view, mask, tagged=tagged)
    if not scene.is_large:
        return None
    expected = noise * scene.squared_depth
    good = _GOOD_FIT * expected
    is_familiar = guess.misfit < math.inf
    found, guess = _fitting(scene, shape, size, guess, good, search=search)
    worst = max(_WORST_FIT * min(size), _NOISY_FIT * expected)
    if (found is None or found.misfit > good) and may_turn():
        found, guess = _turned_anyhow(scene, shape, size, guess, good, found)
    if found is None or found.share < LEAST_SHARE or found.agreement < _AGREEMENT or found.misfit > worst:
        return None
    position, covariance = _in_camera(found, view, size)
    known = turned(scene, shape, size, found, max(found.misfit, _FLOOR))
    sure = _sure_lean(scene, shape, size, found, guess, good, known.tilt_sigma) if is_familiar else None
    has_yaw = order(shape, size) != ROUND and found.share >= _WELL_SEEN
    shows_yaw = sure is not None and has_yaw and known.yaw_sigma < _TELLS_YAW
    if shows_yaw and guess.lean == UPRIGHT:
        guess = guess._replace(yaw=guess.yaw + known.yaw_off)
    guess = guess._replace(followed=sure is not None and (guess.followed or sure != UPRIGHT))
    yaw_sigma = math.hypot(_SURE_OF_YAW, known.yaw_sigma, _TO_COME * known.yaw_off) if shows_yaw else math.inf
    return Placed(position, covariance, guess, found.misfit <= good, sure, yaw_sigma)


def _sure_lean(
    scene: ImagePart, shape: Shape, size: Vector3, found: Fit, guess: Guess, good: float, sigma: float
) -> Quaternion | None:
    """How it leans, if its tilt is known with a standard deviation of `sigma` rad.

    What was followed from a lean until it stood has the side down on which it was before.
    """
    if guess.lean != UPRIGHT and tilt(found.rotation) > LEANS:
        return guess.lean if sigma < _TELLS_LEAN else None
    fits = found.misfit <= min(good, _USUALLY * max(guess.misfit, _FLOOR))
    if not fits or sigma >= _TELLS:
        return None
    return UPRIGHT if guess.followed or is_unlike_fallen(scene, shape, size, found) else None


def _fitting(
    scene: ImagePart, shape: Shape, size: Vector3, guess: Guess, good: float, *, search: bool
) -> tuple[Fit | None, Guess]:
    """The best fit near the guess, or with any yaw; and how it is turned."""
    noisy, good = good, min(good, _USUALLY * max(guess.misfit, _FLOOR))
    upright = _about_z(guess.yaw)
    standing = _stand(scene, shape, size, upright, good)
    if search and guess.misfit == math.inf and standing is not None and order(shape, size) != ROUND:
        guess = guess._replace(yaw=best_yaw(scene, shape, size, guess.yaw))
        upright, search = _about_z(guess.yaw), False
        standing = _stand(scene, shape, size, upright, good)
    if guess.lean == UPRIGHT and standing is not None:
        if standing.misfit <= good:
            known = guess.misfit < math.inf
            usual = guess.misfit + _NEWS * (standing.misfit - guess.misfit) if known else standing.misfit
            return standing, guess._replace(misfit=usual)
        if standing.share < _WELL_SEEN and standing.misfit <= noisy:
            return standing, guess
    before = np.array(quaternions.to_matrix(guess.lean))
    leant = leaning(scene, shape, size, before @ upright, good) if guess.misfit < math.inf else None
    if leant is not None and leant.misfit <= _SURELY * good and not _better(standing, leant):
        return leant, guess._replace(lean=UPRIGHT if tilt(leant.rotation) < _STANDS else lean(leant.rotation, upright))
    if search:
        guess = guess._replace(yaw=best_yaw(scene, shape, size, guess.yaw))
        standing = _stand(scene, shape, size, _about_z(guess.yaw), good)
    return standing, guess._replace(lean=UPRIGHT)


def _turned_anyhow(
    scene: ImagePart, shape: Shape, size: Vector3, guess: Guess, good: float, before: Fit | None
) -> tuple[Fit | None, Guess]:
    """The best fit with any rotation, and how it is turned, if it fits clearly better than the one `before`."""
    found = anyhow(scene, shape, size, good)
    if found is None or found.share < _WELL_SEEN or found.agreement < _AGREEMENT:
        return before, guess
    if before is not None and not _better(found, before):
        return before, guess
    if tilt(found.rotation) < _STANDS:
        yaw = math.atan2(found.rotation[1, 0], found.rotation[0, 0])
        return found, Guess(nearest_alike(yaw, guess.yaw, order(shape, size)), UPRIGHT, found.misfit)
    return found, Guess(guess.yaw, lean(found.rotation, _about_z(guess.yaw)), found.misfit)


def _stand(scene: ImagePart, shape: Shape, size: Vector3, upright: Array, good: float) -> Fit | None:
    """How it fits with that rotation (3, 3); the inside of something hollow may be what little is seen of it.

    None also if that tells two places.
    """
    found = fit(scene, shape, size, upright)
    if len(shape) < 2 or (found is not None and (found.misfit <= good or found.share >= _WELL_SEEN)):
        return found
    rough = [one for one in (found, fit(scene, shape, size, upright, start=BEFORE)) if one is not None]
    fits = sorted((settled(scene, shape, size, one) for one in rough), key=lambda one: one.misfit)
    if len(fits) == 2 and fits[1].misfit < _AS_WELL * fits[0].misfit:
        apart = float(np.linalg.norm(fits[1].position - fits[0].position))
        return fits[0] if apart < _ELSEWHERE else None
    return fits[0] if fits else None


def _better(fitted: Fit | None, other: Fit) -> bool:
    return fitted is not None and fitted.misfit < _CLEARLY * other.misfit


def _in_camera(found: Fit, view: FrameView, size: Vector3) -> tuple[Array, Array]:
    """Where a fitted object is in the camera frame, and how surely."""
    position = view.world_from_camera.inverse().apply(found.position)
    hidden = 1.0 - found.share * found.agreement
    sigma = (_PIXELS_OFF * position[2] / view.intrinsics.fx, _FLOOR, _TRUST * found.misfit, _PULL * hidden * max(size))
    return position, sum(value * value for value in sigma) * np.eye(3)


def best_yaw(scene: ImagePart, shape: Shape, size: Vector3, yaw: float) -> float:
    """The yaw with which the shape fits best, looked for everywhere, then more and more finely around the best.

    Noise of the depth hides some degrees of it. The outline tells more: a shape that is turned otherwise should be seen
    where something else is. So the distances are taken for the seen share of what should be seen.
    """
    misfits: dict[float, float] = {}
    for angles in ((yaw, *_YAWS), *((-step, step) for step in _FINER)):
        best = min(misfits, key=lambda angle: misfits[angle]) if misfits else 0.0
        for angle in (float(best + step) for step in angles):
            found = fit(scene, shape, size, _about_z(angle), ROUGH, ROUGH_RAYS)
            misfits[angle] = math.inf if found is None else found.misfit / max(found.agreement, NO_SHARE)
    return nearest_alike(min(misfits, key=lambda angle: misfits[angle]), yaw, order(shape, size))


def _about_z(yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
