"""Runs the model with LiteRT, as MediaPipe's published graph `hand_landmark_tracking` does.

Palms are detected in the whole image; landmarks are read in a turned square about each. In the next image that square
is laid about the landmarks, and palms are looked for only while fewer than two hands are followed.
"""

from __future__ import annotations

import math
import threading
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color
from agents.hand_tracker.model.files import DETECTOR, LANDMARKER, ModelFiles
from agents.hand_tracker.model.found import FAILURES, FoundHand
from agents.hand_tracker.model.palms import ANCHORS, PIXELS, VALUES, read_palms
from agents.hand_tracker.model.regions import Region, about_hand, about_palm, cut_out, overlap, whole_image
from agents.hand_tracker.sighting import LANDMARKS, PALM
from dsr.errors import ConfigError
from dsr.runtime.native_output import silenced

HANDS = 2
"""Hands that are followed at most."""
_CROP = 224  # px, sides of the picture in which landmarks are read
_DEPTH_SCALE = 0.4  # by which the landmarks' depth in that picture is too small; as in the graph
_SAME_PLACE = 0.5  # intersection over union of the squares of a hand that is followed and of one found anew
_SAME_HAND = 0.25  # distance of two palms, in sides of their squares, below which they are one hand found twice
_DETECTOR_OUTPUTS = ((1, ANCHORS, VALUES), (1, ANCHORS, 1))
_LANDMARK_OUTPUTS = ((1, 3 * LANDMARKS), (1, 1), (1, 1), (1, 3 * LANDMARKS))


class _Looked(NamedTuple):
    """What the model says of one square."""

    hand: FoundHand
    presence: float
    """0 to 1, that there is a hand"""


class LiteRtLandmarker:
    """Finds hands and follows them from image to image.

    Args:
        files: the model.
        least_score: 0 to 1, of a palm, and of a hand in its square, to count.

    Raises:
        ConfigError: if LiteRT is not installed, or it cannot use the model.
    """

    def __init__(self, files: ModelFiles, least_score: float) -> None:
        self._least_score = least_score
        self._detector: _Network | None = _Network(files, DETECTOR, PIXELS, _DETECTOR_OUTPUTS)
        self._landmarks: _Network | None = _Network(files, LANDMARKER, _CROP, _LANDMARK_OUTPUTS)
        self._regions: list[Region] = []
        self._lock = threading.Lock()

    def detect(self, color: Color, milliseconds: int) -> list[FoundHand]:
        """The hands in the next image of the camera; its time does not matter here. Raises one of `FAILURES`."""
        with self._lock:
            if self._detector is None or self._landmarks is None:
                raise RuntimeError("the model is closed")
            found = self._look_again(color)
            if len(found) < HANDS:
                found = self._look_anew(color, found)
            self._regions = [about_hand(hand.landmarks[:, :2]) for hand in found]
            return found

    def close(self) -> None:
        """Release the model; harmless when repeated."""
        with self._lock:
            self._detector = self._landmarks = None

    def _look_again(self, color: Color) -> list[FoundHand]:
        """Where hands were in the image before."""
        return _distinct([self._look(color, region) for region in self._regions], [], self._least_score)

    def _look_anew(self, color: Color, found: list[FoundHand]) -> list[FoundHand]:
        """Where palms are detected that are not those of the hands found already."""
        taken = [about_hand(hand.landmarks[:, :2]) for hand in found]
        regions = [region for region in self._palms(color) if all(overlap(region, r) < _SAME_PLACE for r in taken)]
        return _distinct([self._look(color, region) for region in regions[:HANDS]], found, self._least_score)

    def _palms(self, color: Color) -> list[Region]:
        assert self._detector is not None
        whole = whole_image(color)
        values, logits = self._detector.run(cut_out(color, whole, PIXELS, cv2.BORDER_CONSTANT))
        regions = []
        for palm in read_palms(values[0], logits[0, :, 0], self._least_score):
            corners = whole.in_image(np.vstack([palm.box.reshape(2, 2), palm.wrist, palm.middle]))
            regions.append(about_palm(corners[:2].ravel(), corners[2], corners[3]))
        return [region for region in regions if region.side >= 1.0]

    def _look(self, color: Color, region: Region) -> _Looked:
        assert self._landmarks is not None
        picture = cut_out(color, region, _CROP, cv2.BORDER_REPLICATE)
        marks, presence, is_right, metres = (output.astype(np.float64) for output in self._landmarks.run(picture))
        points = marks.reshape(LANDMARKS, 3) / _CROP
        depth = points[:, 2:] * region.side / _DEPTH_SCALE
        landmarks = np.column_stack([region.in_image(points[:, :2]), depth])
        shape = metres.reshape(LANDMARKS, 3)
        cosine, sine = math.cos(region.turn), math.sin(region.turn)
        shape = shape @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        right = float(is_right[0, 0])
        hand = FoundHand(landmarks, shape, "right" if right >= 0.5 else "left", max(right, 1.0 - right))
        usable = bool(np.isfinite(landmarks).all() and np.isfinite(shape).all())
        return _Looked(hand, float(presence[0, 0]) if usable else 0.0)


def _distinct(looked: list[_Looked], found: list[FoundHand], least: float) -> list[FoundHand]:
    """The hands found already, and those that are there and are none of them, the surest first."""
    hands = list(found)
    for there in sorted(looked, key=lambda one: -one.presence):
        if there.presence >= least and len(hands) < HANDS and not any(_is_same(there.hand, other) for other in hands):
            hands.append(there.hand)
    return hands


def _is_same(a: FoundHand, b: FoundHand) -> bool:
    apart = a.landmarks[list(PALM), :2].mean(axis=0) - b.landmarks[list(PALM), :2].mean(axis=0)
    size = min(about_hand(a.landmarks[:, :2]).side, about_hand(b.landmarks[:, :2]).side)
    return float(np.linalg.norm(apart)) < _SAME_HAND * size


class _Network:
    """One of the model's two networks: a picture in, some tensors out."""

    def __init__(self, files: ModelFiles, name: str, pixels: int, outputs: tuple[tuple[int, ...], ...]) -> None:
        interpreter = _interpreter(files, name)
        (image,) = interpreter.get_input_details()
        answers = interpreter.get_output_details()
        shapes = tuple(tuple(map(int, answer["shape"])) for answer in answers)
        if tuple(image["shape"]) != (1, pixels, pixels, 3) or shapes != outputs:
            raise ConfigError(f"{files.where}: {name} is another model: its tensors are {shapes}, expected {outputs}")
        self._interpreter = interpreter
        self._input = image["index"]
        self._outputs = [answer["index"] for answer in answers]

    def run(self, picture: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        self._interpreter.set_tensor(self._input, picture)
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(index) for index in self._outputs]


def _interpreter(files: ModelFiles, name: str) -> Any:
    """Of one thread: results do not depend on how many processors there are. Raises `ConfigError`."""
    try:
        from ai_edge_litert.interpreter import Interpreter
    except (ImportError, AttributeError, OSError) as error:
        raise ConfigError(
            f"the package ai-edge-litert cannot be imported ({error}); expected the extra `hands`: "
            "pip install 'dsr-memory[hands]'"
        ) from error
    try:
        with silenced():  # it tells which instructions the processor has
            made = Interpreter(model_content=files.contents[name], num_threads=1)
            made.allocate_tensors()
    except FAILURES as error:
        raise ConfigError(f"{files.where}: LiteRT cannot use {name}: {error}") from error
    return made
