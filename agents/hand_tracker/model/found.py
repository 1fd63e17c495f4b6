"""A hand as the model finds it in an image, whichever program runs the model."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color
from agents.hand_tracker.sighting import Side

Array = NDArray[np.float64]


class FoundHand(NamedTuple):
    """One hand in one image."""

    landmarks: Array
    """(21, 3) px: place from the image's upper left corner, and how far behind the wrist"""
    shape: Array
    """(21, 3) m, x right, y down, z away from the camera, about the hand's middle"""
    side: Side
    side_score: float
    """0.5 to 1, how sure that is"""


class Landmarker(Protocol):
    """Finds the landmarks of hands in the images of one camera, one after the other."""

    def detect(self, color: Color, milliseconds: int) -> list[FoundHand]:
        """The hands in an RGB image (h, w, 3); times increase from call to call. Raises one of `FAILURES`."""

    def close(self) -> None:
        """Release the model; harmless when repeated."""


FAILURES = (RuntimeError, ValueError, OSError, IndexError)
"""Exceptions that the programs raise which run the model: kinds of Python's own errors."""
