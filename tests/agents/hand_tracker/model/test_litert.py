"""The real model, run by LiteRT: photos of a real hand beside MediaPipe's own results, and all that is no hand."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing

import numpy as np
import pytest

from agents.hand_tracker.model.files import DETECTOR, LANDMARKER, ModelFiles
from agents.hand_tracker.model.found import FoundHand
from agents.hand_tracker.model.litert import LiteRtLandmarker
from agents.hand_tracker.sighting import TIPS
from agents.plant.reality import Reality
from agents.scenario.format.scenario import HandEnter
from dsr.errors import ConfigError

from ..conftest import Bench, palm_of
from .conftest import REFERENCE, photo

NAMES = sorted(REFERENCE)


def off(hand: FoundHand, landmarks: np.ndarray) -> float:
    """Mean distance of the landmarks in the image, in palm lengths."""
    length = np.linalg.norm(landmarks[9, :2] - landmarks[0, :2])
    return float(np.linalg.norm(hand.landmarks[:, :2] - landmarks[:, :2], axis=1).mean() / length)


@pytest.mark.parametrize("name", NAMES)
def test_landmarks_are_those_of_mediapipe(name: str, landmarker: LiteRtLandmarker) -> None:
    (hand,) = landmarker.detect(photo(name), 0)
    told = REFERENCE[name]["graph"]
    assert off(hand, np.array(told["landmarks_px"])) < 0.01
    assert np.linalg.norm(hand.shape - np.array(told["shape_m"]), axis=1).mean() < 0.001
    assert np.abs(hand.landmarks[:, 2] - np.array(told["landmarks_px"])[:, 2]).mean() < 5.0


@pytest.mark.parametrize("name", NAMES)
def test_the_side_is_that_of_mediapipes_tasks(name: str, landmarker: LiteRtLandmarker) -> None:
    (hand,) = landmarker.detect(photo(name), 0)
    told = REFERENCE[name]["tasks"]
    assert hand.side == told["side"] or min(hand.side_score, told["side_score"]) < 0.7


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_photo_has_turned_landmarks(quarters: int, landmarker: LiteRtLandmarker) -> None:
    image = photo("nocurl")
    (upright,) = landmarker.detect(image, 0)
    with_turn = np.ascontiguousarray(np.rot90(image, -quarters))
    landmarks = upright.landmarks.copy()
    for _ in range(quarters):
        landmarks[:, :2] = np.column_stack([image.shape[0] - landmarks[:, 1], landmarks[:, 0]])
        image = np.rot90(image, -1)
    landmarker.detect(np.zeros((64, 64, 3), np.uint8), 1)  # forgets where the hand was
    (hand,) = landmarker.detect(with_turn, 2)
    assert off(hand, landmarks) < 0.06


def test_a_mirrored_hand_is_the_other_one(landmarker: LiteRtLandmarker) -> None:
    image = photo("fullcurl")
    (hand,) = landmarker.detect(image, 0)
    landmarker.detect(np.zeros_like(image), 1)
    (mirrored,) = landmarker.detect(np.ascontiguousarray(image[:, ::-1]), 2)
    assert {hand.side, mirrored.side} == {"left", "right"}


def test_a_hand_is_followed_while_palms_are_looked_for_elsewhere(
    landmarker: LiteRtLandmarker, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = photo("nocurl")
    (first,) = landmarker.detect(image, 0)
    monkeypatch.setattr(landmarker, "_palms", lambda color: [])
    for step in range(1, 6):
        (hand,) = landmarker.detect(np.roll(image, 12 * step, axis=1), step)
        assert off(hand, first.landmarks + np.array([12.0 * step, 0.0, 0.0])) < 0.08
    assert landmarker.detect(np.zeros_like(image), 6) == [] == landmarker.detect(image, 7)


def test_two_hands_are_two_and_one_is_never_found_twice(landmarker: LiteRtLandmarker) -> None:
    image = photo("nocurl")
    both = np.concatenate([image, image[:, ::-1]], axis=1)
    for moment in range(3):
        hands = landmarker.detect(np.ascontiguousarray(both), moment)
        middles = sorted(float(hand.landmarks[:, 0].mean()) for hand in hands)
        assert len(middles) == 2 and middles[0] < 480.0 < middles[1]


@pytest.mark.parametrize("shape", [(480, 640), (1, 1), (3, 2), (1, 700), (5, 5)], ids=str)
@pytest.mark.parametrize("brightness", [0, 128, 255])
def test_images_without_hands_have_none(shape: tuple[int, int], brightness: int, landmarker: LiteRtLandmarker) -> None:
    assert landmarker.detect(np.full((*shape, 3), brightness, np.uint8), 0) == []


def test_noise_is_no_hand(landmarker: LiteRtLandmarker) -> None:
    rng = np.random.default_rng(0)
    for moment in range(5):
        assert landmarker.detect(rng.integers(0, 256, (240, 320, 3)).astype(np.uint8), moment) == []


def test_a_closed_model_says_so(model_files: ModelFiles) -> None:
    made = LiteRtLandmarker(model_files, 0.5)
    for _ in range(2):
        made.close()
    with pytest.raises(RuntimeError, match="closed"):
        made.detect(np.zeros((64, 64, 3), np.uint8), 0)


def test_networks_in_each_others_place_are_another_model(model_files: ModelFiles) -> None:
    contents = model_files.contents
    swapped = ModelFiles("swapped.task", {DETECTOR: contents[LANDMARKER], LANDMARKER: contents[DETECTOR]})
    with pytest.raises(ConfigError, match=r"swapped\.task: hand_detector\.tflite is another model"):
        LiteRtLandmarker(swapped, 0.5)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3])
def test_what_only_begins_like_a_network_is_a_clear_error(share: float, model_files: ModelFiles) -> None:
    contents = dict(model_files.contents)
    contents[DETECTOR] = contents[DETECTOR][: int(share * len(contents[DETECTOR]))]
    with pytest.raises(ConfigError, match="LiteRT cannot use hand_detector"):
        LiteRtLandmarker(ModelFiles("half.task", contents), 0.5)


@pytest.mark.parametrize("number", [0, 1], ids=["right", "left"])
def test_rendered_hands_are_found_with_their_side_and_fingertips(
    number: int, model_files: ModelFiles, make_reality: Callable[..., Reality]
) -> None:
    errors, found, right_side = [], 0, 0
    for height in (0.08, 0.14, 0.2):
        event = HandEnter(at=0.0, hand=number, position=(0.36, 0.0, height), side=(1.0, 0.3))
        reality = make_reality(1.6, events=[event])
        color, camera = reality.frame(0.0).arrays["color"], reality.camera
        points = camera.intrinsics.project(camera.pose.inverse().apply(np.array(reality.truth(0.0).hands[number])))
        with closing(LiteRtLandmarker(model_files, 0.5)) as landmarker:
            for hand in landmarker.detect(color, 0):
                found += 1
                right_side += hand.side == ("left" if number else "right")
                length = np.linalg.norm(points[9] - points[0])
                errors += [np.linalg.norm(hand.landmarks[tip, :2] - 0.5 - points[tip]) / length for tip in TIPS]
        reality.close()
    assert found == 3 == right_side
    assert np.median(errors) < 0.06


def test_the_tracker_writes_rendered_hands_by_the_model(
    model_file: object, make_bench: Callable[..., Bench], make_reality: Callable[..., Reality]
) -> None:
    events = [HandEnter(at=0.0, position=(0.40, 0.10, 0.10)), HandEnter(at=0.0, hand=1, position=(0.40, -0.12, 0.10))]
    reality = make_reality(2.0, events=events)
    bench = make_bench()
    for _ in range(3):
        bench.show(reality.frame(0.0))
    assert bench.hands() == ["human_hand_0", "human_hand_1"] and bench.agent.degraded == ""
    for number, (name, side) in enumerate(zip(bench.hands(), ("right", "left"), strict=True)):
        node = bench.memory.node(name)
        assert (node["source"], node["side"]) == ("mediapipe", side)
        truth = np.array(reality.truth(0.0).hands[number])
        assert np.linalg.norm(palm_of(truth) - bench.place(name)) < 0.01
