"""The real model as a finder of hands: its landmarks in the image, made points in space by the depth image.

The model guesses where hidden fingertips are, and depth there is that of the hand before them. So fingertips that the
outline of the skin shows near the model's are told beside these. A hand that the model loses goes on with its outline.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Depth
from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.depth import behind_surface, depth_at, images_with_depth
from agents.hand_tracker.going_on import GoingOn
from agents.hand_tracker.model.found import FoundHand, Landmarker
from agents.hand_tracker.sighting import (
    LANDMARKS,
    LEAST_OF_PALM,
    PALM,
    SHAPE_TURN,
    TIPS,
    OutlinedTip,
    SeenHand,
    Side,
    Source,
    hand_of_landmarks,
)
from agents.hand_tracker.skin import SkinFinder
from dsr.images.blobs import Frame
from dsr.math3d import quaternions
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]

SIGMA = 0.005
"""m, standard deviation of each coordinate of a landmark with depth"""
_MOST_OFF = 0.03
"""m, how far the depth at a landmark may be from where the hand's shape says, for it to be that landmark's."""
_WRIST, _MIDDLE_KNUCKLE = 0, 9
"""Landmarks between which the palm's length is measured"""
_DEPTH_OFF = 0.01
"""m, standard deviation of the errors of the shape and of depth along the view"""
_STRAIGHT = 1e-9  # sine of the angle between a ray and the optical axis that count as one
_SAME_TIP = 0.5
"""Of the palm's length in the image, how far a fingertip of the outline may be from all that the model has: 45 mm"""


class ModelFinder:
    """Finds hands with MediaPipe's model.

    Args:
        config: of the tracker.
        landmarker: the model.
    """

    source: Source = "mediapipe"

    def __init__(self, config: HandTrackerConfig, landmarker: Landmarker) -> None:
        self._config = config
        self._landmarker = landmarker
        self._skin = SkinFinder(config)
        self._going_on = GoingOn()
        self._milliseconds = -1

    def find(self, frame: Frame, table: Array | None) -> list[SeenHand]:
        """The hands in a frame; the `table` keeps its wood from being skin. Raises `WireError`, or `FAILURES`."""
        color, depth, intrinsics = images_with_depth(frame)
        self._milliseconds = max(self._milliseconds + 1, round(frame.stamp * 1000.0))
        found = []
        hands = self._landmarker.detect(np.ascontiguousarray(color), self._milliseconds)
        outlines = self._skin.find(frame, table) if hands or self._going_on.waits else []
        outlined = [tip for outline in outlines for tip in outline.tips.values()]
        for hand in hands:
            pixels = hand.landmarks[:, :2] - 0.5
            shape = _as_seen(hand.shape, pixels, intrinsics)
            points, seen = self._in_space(pixels, shape, depth, intrinsics)
            there = hand_of_landmarks(points, seen, self._side(hand), SIGMA, shape)
            if there is not None:
                tips = _outlined(np.array(outlined), intrinsics, pixels) if outlined else ()
                found.append(there._replace(outlined=tips))
        return found + self._going_on.update(found, outlines, frame.stamp)

    def close(self) -> None:
        """Release the model."""
        self._landmarker.close()

    def _side(self, hand: FoundHand) -> Side:
        if hand.side == "unknown" or hand.side_score < self._config.least_side_score:
            return "unknown"
        return "right" if (hand.side == "right") is not self._config.swap_sides else "left"

    def _in_space(
        self, pixels: Array, shape: Array, depth: Depth, intrinsics: Intrinsics
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Points (21, 3) m in the camera's frame, and which of them (21,) the depth image really shows.

        Depths that contradict the shape which the model gives the hand (m, in axes of the camera), tilted as is likely,
        are those of something in front of it, or of what is seen between fingers.
        """
        points, seen = np.zeros((LANDMARKS, 3)), np.zeros(LANDMARKS, bool)
        radii = np.full(LANDMARKS, self._config.palm_radius)
        radii[[k for tip in TIPS for k in (tip - 2, tip - 1, tip)]] = self._config.fingertip_radius
        inside = (pixels >= 0).all(axis=1) & (pixels <= (intrinsics.width - 1, intrinsics.height - 1)).all(axis=1)
        surface = np.full(LANDMARKS, np.nan)
        scale = self._pixels_per_metre(pixels, shape)
        for k in np.flatnonzero(inside):
            there = depth_at(depth, pixels[k], 0.4 * radii[k] * scale)
            surface[k] = np.nan if there is None else there
        if not np.isfinite(surface).any():
            return points, seen
        fits = _fitting(surface + radii, shape)
        for k in np.flatnonzero(np.isfinite(surface)):
            points[k] = behind_surface(pixels[k], float(surface[k]), float(radii[k]), intrinsics)
            seen[k] = fits[k] and np.isfinite(points[k]).all()
        return points, seen

    @staticmethod
    def _pixels_per_metre(pixels: Array, shape: Array) -> float:
        """How large the hand is in the image, compared with its shape across the view."""
        in_image = np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).sum()
        in_space = np.linalg.norm(shape[:, :2] - shape[:, :2].mean(axis=0), axis=1).sum()
        return float(in_image / max(in_space, 1e-6))


def _as_seen(shape: Array, pixels: Array, intrinsics: Intrinsics) -> Array:
    """A shape (21, 3) m in axes of the camera.

    The network sees a crop of the image, and tells how the hand is turned as if the camera looked straight at it. Where
    the lens shows nothing, the shape stays as it is.
    """
    ray = intrinsics.rays(pixels.mean(axis=0)[None])[0]
    if not np.isfinite(ray).all():
        return shape
    x, y, z = (ray / np.linalg.norm(ray)).tolist()
    tilt = math.atan2(math.hypot(x, y), z) / max(math.hypot(x, y), _STRAIGHT)
    turn = quaternions.to_matrix(quaternions.from_rotvec((-y * tilt, x * tilt, 0.0)))
    return np.asarray(shape @ np.array(turn).T, dtype=np.float64)


def _fitting(depths: Array, shape: Array) -> NDArray[np.bool_]:
    """(21,) which depths (21,) m, NaN where unknown, are those of a shape (21, 3) m that is moved along the view.

    The network tells the tilt of a hand about as well as `SHAPE_TURN`. If the palm fits as it is told, what fits so
    tells the tilt, and more of the hand may fit then. Otherwise a tilt might fit what hides the hand.
    """
    off = depths - shape[:, 2]
    told = np.abs(off - np.nanmedian(off)) < _MOST_OFF
    if told[list(PALM)].sum() < LEAST_OF_PALM:
        return told
    by = np.stack([np.ones(LANDMARKS), shape[:, 1], -shape[:, 0]], axis=1)
    prior = np.diag([0.0, *[(_DEPTH_OFF / SHAPE_TURN) ** 2] * 2])
    found = np.linalg.solve(by[told].T @ by[told] + prior, by[told].T @ off[told])
    return np.asarray(told | (np.abs(off - by @ found) < _MOST_OFF), dtype=np.bool_)


def _outlined(tips: Array, intrinsics: Intrinsics, pixels: Array) -> tuple[OutlinedTip, ...]:
    """Those of the outline's fingertips (n, 3) m that are near a fingertip of the landmarks at `pixels` (21, 2)."""
    most = _SAME_TIP * float(np.linalg.norm(pixels[_MIDDLE_KNUCKLE] - pixels[_WRIST]))
    apart = np.linalg.norm(intrinsics.project(tips)[:, None] - pixels[None, list(TIPS)], axis=2)
    across = apart * (tips[:, 2:] / intrinsics.fx)
    return tuple(OutlinedTip(tip, away) for tip, away, px in zip(tips, across, apart, strict=True) if px.min() <= most)
