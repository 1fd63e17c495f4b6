"""Hand-eye calibration as a function: points of a target in images and poses of the hand in, a report out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.calibrator.hand_eye.advice import advise
from agents.calibrator.hand_eye.fit import Fitted, Fitter
from agents.calibrator.hand_eye.model import Parameters, ViewModel
from agents.calibrator.hand_eye.observations import HandNoise, Observations, pose_noises
from agents.calibrator.hand_eye.priors import prior_of
from agents.calibrator.hand_eye.reading import ToldHands
from agents.calibrator.hand_eye.report import HandEyeReport, make_report
from agents.calibrator.hand_eye.start import StartGuess, find_start
from agents.calibrator.hand_eye.targets import Target
from dsr.errors import ConfigError
from dsr.math3d.batches import rotvecs
from dsr.math3d.transforms import Array
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

Lens = Literal["pinhole", "plumb_bob", "rational_polynomial", "equidistant"]
_COEFFICIENTS: dict[Lens, int] = {"pinhole": 0, "plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
LEAST_VIEWS = 3
"""Views that determine a mount at all; only more of them show which are wrong"""
_LEAST_TURN = 0.05
"""rad that the hand must turn, root mean square, about a second axis as well"""
_UNIT = 1.3
"""Ratio of lengths of the robot and of the images from which one of them is in another unit"""
_USUAL_JOINT = 1e-3
"""rad, standard deviation of joints where nobody states one: encoder, play and bending of a robot arm"""


class Setting(NamedTuple):
    """What is asked for."""

    is_in_hand: bool = True
    """Whether the hand carries the camera, and the target stands; otherwise it is the other way round"""
    lens: Lens | None = None
    """Model of a lens to be fitted; None if the intrinsics are known"""
    fits_joints: bool = False
    """Whether a constant error of each joint is fitted, too"""
    position_std: float | None = None
    """m, standard deviation of the hand's position as the robot tells it; None for what the residuals show"""
    rotation_std: float | None = None
    """rad, likewise of its rotation"""
    joint_std: float | None = None
    """rad or m, likewise of each joint; counts instead of these two if joints are told"""
    size_std: float = 0.01
    """Standard deviation of the target's true size over the told one"""
    offset_std: float = 0.02
    """rad or m, usual constant error of a joint, where these are fitted"""
    seed: int = 0
    """Draws the views that are tried together for a start"""


class Solution(NamedTuple):
    """A fit with what it is about."""

    observations: Observations
    model: ViewModel
    fitted: Fitted


def calibrate_hand_eye(
    names: Sequence[str],
    hands: ToldHands,
    images: Sequence[NDArray[np.uint8]],
    target: Target,
    intrinsics: Intrinsics | None,
    setting: Setting,
) -> HandEyeReport:
    """Find the target in images, and the camera's mount by it.

    Args:
        names: of the images, for people.
        hands: where the hand was at each.
        images: grey, all of one size.
        target: what is in the images.
        intrinsics: of the camera; None to fit them from nothing.
        setting: what is asked for.

    Raises:
        ConfigError: if that tells too little, or contradicts itself: says what to do.
    """
    found = [target.find(image) for image in images]
    height, width = images[0].shape
    rows = [row for row, points in enumerate(found) if points is not None]
    missing = [name for name, points in zip(names, found, strict=True) if points is None]
    if not rows:
        raise ConfigError(f"the target {target.name} was found in none of {len(names)} images; is it wholly in view?")
    observations = observed(
        [names[row] for row in rows],
        ToldHands(hands.images, hands.poses[rows], None if hands.joint_effects is None else hands.joint_effects[rows]),
        np.array([found[row] for row in rows]),
        target,
        (width, height),
        setting,
    )
    solution = solve(observations, intrinsics, setting, missing=len(missing))
    return make_report(
        target.name,
        solution.model,
        solution.fitted,
        not_found=missing,
        joint_names=hands.joint_names,
        advice=advise(solution.model, solution.fitted),
    )


def observed(
    names: Sequence[str], hands: ToldHands, pixels: Array, target: Target, size: tuple[int, int], setting: Setting
) -> Observations:
    """Observations of points (v, n, 2) px that were found, with the noise that a setting states."""
    noises: tuple[HandNoise, ...] = pose_noises(hands.poses, setting.position_std, setting.rotation_std)
    if hands.joint_effects is not None:
        std = _USUAL_JOINT if setting.joint_std is None else setting.joint_std
        noises = (HandNoise("joints", "rad", hands.joint_effects, std, setting.joint_std is not None),)
    return Observations(
        tuple(names), hands.poses, pixels, target.points, target.symmetries, noises, _knowable(hands.joint_effects),
        setting.is_in_hand, size,
    )  # fmt: skip


def _knowable(joint_effects: Array | None) -> Array | None:
    """Effects of constant errors that can be told apart from others: those of the joints in between.

    That of the first joint turns the base, that of the last one the hand, and so only what is mounted there.
    """
    if joint_effects is None:
        return None
    effects = joint_effects.copy()
    effects[:, :, [0, -1]] = 0.0
    return effects


def solve(observations: Observations, intrinsics: Intrinsics | None, setting: Setting, *, missing: int = 0) -> Solution:
    """Fit a mount to observations.

    Args:
        observations: of the views that show the target.
        intrinsics: as of `calibrate_hand_eye`.
        setting: what is asked for.
        missing: images in which the target was not found, for the error.

    Raises:
        ConfigError: as `calibrate_hand_eye`.
    """
    _check(observations, missing, setting)
    if intrinsics is None and setting.lens is None:
        raise ConfigError("the intrinsics are not known: tell or fit them")
    lens = _guessed(observations) if intrinsics is None else intrinsics
    start = find_start(observations, lens, setting.seed)
    _check_unit(start)
    model = ViewModel(
        observations.reordered(start.orders), fits_lens=setting.lens is not None, fits_offsets=setting.fits_joints
    )
    if setting.lens is not None and (lens.distortion is None or lens.distortion.model != setting.lens):
        count = _COEFFICIENTS[setting.lens]
        distortion = None if setting.lens == "pinhole" else Distortion(setting.lens, (0.0,) * count)
        lens = msgspec.structs.replace(lens, distortion=distortion)
    effects = observations.joint_effects
    guess = Parameters(
        start.mount,
        start.target,
        0.0,
        lens,
        np.tile(np.eye(4), (len(observations), 1, 1)),
        np.zeros(0 if effects is None or not setting.fits_joints else effects.shape[2]),
    )
    fitted = Fitter(model, prior_of(model, guess, setting.size_std, setting.offset_std)).fit(guess)
    return Solution(model.observations, model, fitted)


def _check(observations: Observations, missing: int, setting: Setting) -> None:
    """Raise `ConfigError` for views that cannot determine a mount."""
    count = len(observations)
    lost = f"; in {missing} images the target was not found" if missing else ""
    if count < LEAST_VIEWS:
        raise ConfigError(f"{count} view(s) of the target: at least {LEAST_VIEWS} are needed, 10 are usual{lost}")
    if setting.fits_joints and observations.joint_effects is None:
        raise ConfigError("errors of joints are fitted from joint positions: tell these, and a robot description")
    turns = observations.hands[:, None, :3, :3] @ np.swapaxes(observations.hands[None, :, :3, :3], -1, -2)
    moves = rotvecs(turns.reshape(-1, 3, 3))
    _, sizes, axes = np.linalg.svd(moves, full_matrices=False)
    first, second = (float(size) / math.sqrt(len(moves)) for size in sizes[:2])
    if first < _LEAST_TURN:
        raise ConfigError(
            f"the hand turns by {math.degrees(first):.1f} degrees only between the views: moves without a turn do not "
            "tell where the camera is; turn the hand by 20 to 40 degrees, about different axes"
        )
    if second < _LEAST_TURN:
        axis = ", ".join(f"{value:.2f}" for value in axes[0])
        raise ConfigError(
            f"the hand turns about one axis only, ({axis}) in the base: along that axis the camera's place cannot be "
            "told; add views that are turned by 20 to 40 degrees about another axis"
        )


def _check_unit(start: StartGuess) -> None:
    """Raise `ConfigError` if the robot and the images do not have the same unit of length."""
    if 1.0 / _UNIT < start.scale < _UNIT:
        return
    unit = "the hand's poses seem to be in mm, not m" if 500.0 < start.scale < 2000.0 else (
        "the target's size seems to be in mm, not m" if 5e-4 < start.scale < 2e-3 else "is the target's size right?"
    )  # fmt: skip
    raise ConfigError(f"the hand moves {start.scale:.3g} times as far as the images show: {unit}")


def _guessed(observations: Observations) -> Intrinsics:
    """Intrinsics from views of a flat target alone, without distortion, as a start (Zhang 2000, by OpenCV)."""
    width, height = observations.size
    guess = Intrinsics(width, width, 0.5 * (width - 1), 0.5 * (height - 1), width, height)
    seen = observations.seen
    points = [observations.points[view].astype(np.float32) for view in seen]
    pixels = [observations.pixels[row][view].astype(np.float32) for row, view in enumerate(seen)]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    try:
        _, matrix, *_ = cv2.calibrateCamera(points, pixels, (width, height), guess.matrix, np.zeros(5), flags=flags)
    except cv2.error:
        return guess
    focal = float(matrix[0, 0])
    usual = 0.2 * width < focal < 20.0 * width
    return msgspec.structs.replace(guess, fx=focal, fy=focal) if usual else guess
