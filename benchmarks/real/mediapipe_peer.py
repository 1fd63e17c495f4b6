"""What MediaPipe itself finds in photos, as JSON: run as a file by the Python of an environment with mediapipe.

The environment is one of its own, because mediapipe brings another OpenCV; this project is not in it. Version 0.10.21
still has both of MediaPipe's programs for hands: `solutions`, which is the graph that was published with the model, and
`tasks`. Later versions have `tasks` only.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any


def main(model: str, *photos: str) -> None:
    """Print, for each program, what it finds in each photo and how long it takes."""
    import mediapipe

    programs: dict[str, Any] = {"tasks": _tasks(mediapipe, model)}
    if hasattr(mediapipe, "solutions"):
        programs["graph"] = _graph(mediapipe)
    found = {name: {photo: _timed(look, photo) for photo in photos} for name, look in programs.items()}
    json.dump({"version": mediapipe.__version__, "programs": found}, sys.stdout)


def _timed(look: Callable[[Any], list[dict[str, Any]]], photo: str) -> dict[str, Any]:
    import cv2
    import numpy as np

    image = cv2.imread(photo)
    assert image is not None, photo
    color = np.ascontiguousarray(image[..., ::-1])
    begun = time.process_time()
    hands = look(color)
    return {"seconds": time.process_time() - begun, "hands": hands}


def _tasks(mediapipe: Any, model: str) -> Callable[[Any], list[dict[str, Any]]]:
    from mediapipe.tasks.python import BaseOptions, vision

    options = vision.HandLandmarkerOptions(base_options=BaseOptions(model_asset_path=model), num_hands=2)

    def look(color: Any) -> list[dict[str, Any]]:
        with vision.HandLandmarker.create_from_options(options) as landmarker:
            image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=color)
            result = landmarker.detect(image)
        told = zip(result.hand_landmarks, result.hand_world_landmarks, result.handedness, strict=True)
        return [_hand(marks, local, sides[0].category_name, color) for marks, local, sides in told]

    return look


def _graph(mediapipe: Any) -> Callable[[Any], list[dict[str, Any]]]:
    options = {"static_image_mode": True, "max_num_hands": 2, "model_complexity": 1}

    def look(color: Any) -> list[dict[str, Any]]:
        with mediapipe.solutions.hands.Hands(**options) as program:
            result = program.process(color)
        told = zip(
            result.multi_hand_landmarks or [],
            result.multi_hand_world_landmarks or [],
            result.multi_handedness or [],
            strict=True,
        )
        mirrored = {"Left": "Right", "Right": "Left"}  # it takes images for mirrored ones
        return [
            _hand(marks.landmark, local.landmark, mirrored[side.classification[0].label], color)
            for marks, local, side in told
        ]

    return look


def _hand(marks: Any, local: Any, side: str, color: Any) -> dict[str, Any]:
    height, width = color.shape[:2]
    landmarks = [(mark.x * width, mark.y * height, mark.z * width) for mark in marks]
    return {"side": side.lower(), "landmarks": landmarks, "shape": [(mark.x, mark.y, mark.z) for mark in local]}


if __name__ == "__main__":
    main(*sys.argv[1:])
