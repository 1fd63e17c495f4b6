"""MediaPipe's `HandLandmarker` as a finder: landmarks in the image, made points in space by the depth image."""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color, Depth
from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.depth import behind_surface, depth_at, images_with_depth
from agents.hand_tracker.sighting import LANDMARKS, TIPS, SeenHand, Side, Source, hand_of_landmarks
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]

ENTRIES = ("hand_detector.tflite", "hand_landmarks_detector.tflite")
"""Files that a model file, a zip archive, contains."""
HOW_TO_GET = "it is MediaPipe's 'HandLandmarker (full)', see https://ai.google.dev/edge/mediapipe/solutions/vision/hand_landmarker"
SIGMA = 0.005
"""m, standard deviation of each coordinate of a landmark with depth"""
FAILURES = (RuntimeError, ValueError, OSError, IndexError)
"""Exceptions that MediaPipe raises: a kind of Python's own errors for each of its states."""
_MOST_OFF = 0.03
"""m, how far the depth at a landmark may be from where the hand's shape says, for it to be that landmark's."""


class Landmarker(Protocol):
    """The used part of `mediapipe.tasks.vision.HandLandmarker`, behind one call."""

    def detect(self, color: Color, milliseconds: int) -> Any:
        """A `HandLandmarkerResult` for an RGB image (h, w, 3); times increase from call to call."""

    def close(self) -> None:
        """Release the model."""


class MediaPipeFinder:
    """Finds hands with MediaPipe.

    Args:
        config: of the tracker.
        landmarker: the model.
    """

    source: Source = "mediapipe"

    def __init__(self, config: HandTrackerConfig, landmarker: Landmarker) -> None:
        self._config = config
        self._landmarker = landmarker
        self._milliseconds = -1

    def find(self, frame: Frame, table: Array | None) -> list[SeenHand]:
        """The hands in a frame; `table` is not needed. Raises `WireError` for an unusable frame, or `FAILURES`."""
        color, depth, intrinsics = images_with_depth(frame)
        self._milliseconds = max(self._milliseconds + 1, round(frame.stamp * 1000.0))
        result = self._landmarker.detect(np.ascontiguousarray(color), self._milliseconds)
        found = []
        for landmarks, local, handedness in zip(
            result.hand_landmarks, result.hand_world_landmarks, result.handedness, strict=True
        ):
            if len(landmarks) == len(local) == LANDMARKS and handedness[0].score >= self._config.least_score:
                pixels = np.array([(mark.x * intrinsics.width, mark.y * intrinsics.height) for mark in landmarks]) - 0.5
                shape = np.array([(mark.x, mark.y, mark.z) for mark in local])
                points, seen = self._in_space(pixels, shape, depth, intrinsics)
                hand = hand_of_landmarks(points, seen, self._side(handedness[0].category_name), SIGMA)
                found += [] if hand is None else [hand]
        return found

    def close(self) -> None:
        """Release the model."""
        self._landmarker.close()

    def _side(self, name: str) -> Side:
        right = (name == "Right") is not self._config.swap_sides
        return "right" if right else "left"

    def _in_space(
        self, pixels: Array, shape: Array, depth: Depth, intrinsics: Intrinsics
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Points (21, 3) m in the camera's frame, and which of them (21,) the depth image really shows.

        Depths that contradict the shape which MediaPipe gives the hand (m, about its middle) are those of something in
        front of it, or of what is seen between fingers.
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
        centre = float(np.nanmedian(surface + radii - shape[:, 2]))
        for k in np.flatnonzero(np.isfinite(surface)):
            points[k] = behind_surface(pixels[k], float(surface[k]), float(radii[k]), intrinsics)
            seen[k] = abs(surface[k] + radii[k] - shape[k, 2] - centre) < _MOST_OFF
        return points, seen

    @staticmethod
    def _pixels_per_metre(pixels: Array, shape: Array) -> float:
        """How large the hand is in the image, compared with its shape across the view."""
        in_image = np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).sum()
        in_space = np.linalg.norm(shape[:, :2] - shape[:, :2].mean(axis=0), axis=1).sum()
        return float(in_image / max(in_space, 1e-6))


def check_model(file: Path) -> None:
    """Raise `ConfigError` unless `file` can be a hand landmarker model."""
    try:
        size = file.stat().st_size if file.is_file() else None
    except (OSError, ValueError) as error:
        raise ConfigError(f"model file {str(file)!r} cannot be read ({error}); {HOW_TO_GET}") from error
    if size is None:
        raise ConfigError(f"no model file {str(file)!r}; {HOW_TO_GET}")
    if size == 0:
        raise ConfigError(f"model file {str(file)!r} is empty; {HOW_TO_GET}")
    try:
        with zipfile.ZipFile(file) as archive:
            missing = [entry for entry in ENTRIES if entry not in archive.namelist()]
            broken = archive.testzip()
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, *FAILURES) as error:
        raise ConfigError(f"model file {str(file)!r} is corrupt ({error}); {HOW_TO_GET}") from error
    if missing or broken:
        wrong = f"lacks {', '.join(missing)}" if missing else f"is corrupt at {broken}"
        raise ConfigError(f"model file {str(file)!r} {wrong}; {HOW_TO_GET}")


def load_landmarker(model: str) -> Callable[[], Landmarker]:
    """Makes landmarkers with the model file. Raises `ConfigError` if the file or the package cannot be used.

    The package is imported here: that takes a second or two.
    """
    if not model:
        raise ConfigError(f"no `model` is configured; {HOW_TO_GET}")
    check_model(Path(model))
    try:
        import mediapipe
        from mediapipe.tasks.python import BaseOptions, vision
    except (ImportError, AttributeError, OSError) as error:
        raise ConfigError(
            f"the package mediapipe cannot be imported ({error}); expected the extra `hands` (see docs/how-to/hands.md)"
        ) from error

    def make() -> Landmarker:
        options = vision.HandLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=model),
            running_mode=vision.RunningMode.VIDEO,
            num_hands=2,
        )
        try:
            return _TasksLandmarker(mediapipe, vision.HandLandmarker.create_from_options(options))
        except FAILURES as error:
            raise ConfigError(f"MediaPipe cannot use the model {model!r}: {error}") from error

    return make


class _TasksLandmarker:
    """A `HandLandmarker` of MediaPipe's Tasks API, in video mode."""

    def __init__(self, mediapipe: Any, landmarker: Any) -> None:
        self._mediapipe = mediapipe
        self._landmarker = landmarker

    def detect(self, color: Color, milliseconds: int) -> Any:
        """The result for one image of a video. Raises one of `FAILURES`."""
        image = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=color)
        return self._landmarker.detect_for_video(image, milliseconds)

    def close(self) -> None:
        """Release the model."""
        self._landmarker.close()
