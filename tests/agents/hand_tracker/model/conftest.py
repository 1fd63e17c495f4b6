"""Photos of a real hand with what MediaPipe finds in them, and landmarkers of the real model."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from agents.hand_tracker.model.files import ModelFiles, read_model
from agents.hand_tracker.model.litert import LiteRtLandmarker

PHOTOS = Path(__file__).parents[1] / "photos"
REFERENCE: dict[str, Any] = json.loads((PHOTOS / "mediapipe.json").read_text(encoding="utf-8"))["pictures"]
"""What MediaPipe 0.10.21 finds in the photos."""


def photo(name: str) -> NDArray[np.uint8]:
    """(h, w, 3) RGB"""
    return np.ascontiguousarray(cv2.imread(str(PHOTOS / f"{name}.jpg"))[..., ::-1])


@pytest.fixture(scope="session")
def model_files(model_file: Path) -> ModelFiles:
    return read_model(model_file)


@pytest.fixture
def landmarker(model_files: ModelFiles) -> Iterator[LiteRtLandmarker]:
    with closing(LiteRtLandmarker(model_files, 0.5)) as made:
        yield made
