"""Runs the model with MediaPipe's own program, `HandLandmarker` of its Tasks API, in video mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color
from agents.hand_tracker.model.files import read_model
from agents.hand_tracker.model.found import FAILURES, FoundHand
from agents.hand_tracker.sighting import LANDMARKS, Side
from dsr.errors import ConfigError

_SIDES: dict[str, Side] = {"Left": "left", "Right": "right"}


class TasksLandmarker:
    """Finds hands and follows them from image to image. Importing the package takes a second or two.

    Whoever made it must close it: MediaPipe can hang where the garbage collector does.

    Args:
        file: the model.
        least_score: 0 to 1, of a palm, and of a hand in its square, to count.

    Raises:
        ConfigError: if the file or the package cannot be used.
    """

    def __init__(self, file: Path, least_score: float) -> None:
        read_model(file)
        try:
            import mediapipe
            from mediapipe.tasks.python import BaseOptions, vision
        except (ImportError, AttributeError, OSError) as error:
            raise ConfigError(
                f"the package mediapipe cannot be imported ({error}); expected the extra `mediapipe` in an environment "
                "of its own (see docs/how-to/hands.md)"
            ) from error
        options = vision.HandLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=str(file)),
            running_mode=vision.RunningMode.VIDEO,
            num_hands=2,
            min_hand_detection_confidence=least_score,
            min_hand_presence_confidence=least_score,
        )
        self._mediapipe: Any = mediapipe
        try:
            self._landmarker: Any = vision.HandLandmarker.create_from_options(options)
        except FAILURES as error:
            raise ConfigError(f"MediaPipe cannot use the model {str(file)!r}: {error}") from error

    def detect(self, color: Color, milliseconds: int) -> list[FoundHand]:
        """The hands in the next image of a video. Raises one of `FAILURES`."""
        image = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=color)
        result = self._landmarker.detect_for_video(image, milliseconds)
        return read_result(result, color.shape[1], color.shape[0])

    def close(self) -> None:
        """Release the model; harmless when repeated."""
        self._landmarker.close()


def read_result(result: Any, width: int, height: int) -> list[FoundHand]:
    """The hands of a `HandLandmarkerResult` for an image of that size, px."""
    found = []
    told = zip(result.hand_landmarks, result.hand_world_landmarks, result.handedness, strict=True)
    for marks, local, sides in told:
        if len(marks) == len(local) == LANDMARKS and sides:
            side = _SIDES.get(sides[0].category_name, "unknown")
            landmarks = _points(marks) * (width, height, width)
            found.append(FoundHand(landmarks, _points(local), side, float(sides[0].score)))
    return found


def _points(marks: Any) -> NDArray[np.float64]:
    return np.array([(mark.x, mark.y, mark.z) for mark in marks])
