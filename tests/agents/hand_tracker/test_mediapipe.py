"""The real MediaPipe behind the tracker, with a model whose weights are made up. Skipped where it is not installed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from agents.hand_tracker import HandTrackerConfig
from agents.hand_tracker.landmarker import ModelFinder
from agents.hand_tracker.model.found import FAILURES, Landmarker
from agents.hand_tracker.model.tasks import TasksLandmarker
from dsr import Frame
from dsr.errors import ConfigError

from .conftest import RECORDED, Bench, in_world
from .test_landmarker import ENTRIES, archive

pytest.importorskip("mediapipe", reason="the package mediapipe (extra `mediapipe`) is not installed")

HAND = RECORDED["frames"][0]["hands"][0]
SHAPE = np.array(HAND["world_landmarks"])
DISTANCE = 0.5
"""m, from the camera to the wall that everything is seen on"""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    from .made_up_model import write_model

    crop = np.column_stack([112.0 + 600.0 * SHAPE[:, :2], 600.0 * SHAPE[:, 2]])
    return str(write_model(tmp_path_factory.mktemp("model") / "hand_landmarker.task", crop, SHAPE))


def wall(brightness: int, stamp: float = 0.0) -> Frame:
    meta = {"fx": RECORDED["fx"], "fy": RECORDED["fx"], "cx": RECORDED["cx"], "cy": RECORDED["cy"]}
    color = np.full((480, 640, 3), brightness, np.uint8)
    return Frame(stamp, {"color": color, "depth": np.full((480, 640), DISTANCE, np.float32)}, meta)


@pytest.fixture
def landmarker(model: str) -> Iterator[Landmarker]:
    """Closed in any case: MediaPipe can hang where the garbage collector does it."""
    with closing(TasksLandmarker(Path(model), 0.5)) as made:
        yield made


def test_no_hand_in_the_dark_one_in_the_light(landmarker: Landmarker) -> None:
    finder = ModelFinder(HandTrackerConfig(), landmarker)
    assert finder.find(wall(0, 1.0), None) == []
    (hand,) = finder.find(wall(255, 1.05), None)
    assert hand.side == "right" and len(hand.tips) >= 3
    assert finder.find(wall(255, 0.5), None) != []  # the clock of a camera that goes back is no error
    finder.close()  # and is closed once more afterwards


def test_landmarks_are_about_the_box_of_the_hand(landmarker: Landmarker) -> None:
    """The made-up detector puts it in the middle of the image, MediaPipe the crop a little further to the fingers."""
    (hand,) = landmarker.detect(wall(255).arrays["color"], 1000)
    u, v, _ = hand.landmarks.mean(axis=0)
    assert hand.landmarks.shape == (21, 3) and 240.0 < u < 400.0 and 120.0 < v < 280.0


def test_images_come_from_any_thread_and_times_must_increase(landmarker: Landmarker) -> None:
    color = wall(255).arrays["color"]
    found: list[int] = []
    thread = threading.Thread(target=lambda: found.append(len(landmarker.detect(color, 1000))))
    thread.start()
    thread.join()
    with pytest.raises(FAILURES):
        landmarker.detect(color, 999)
    assert len(landmarker.detect(color, 1001)) >= 1 and found == [1]


def test_the_tracker_writes_the_hand_and_closes_the_model(model: str, make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(model=model, runner="mediapipe")
    bench.show(wall(0), ticks=2)
    assert bench.hands() == [] and bench.agent.degraded == ""
    bench.show(wall(255))
    assert "human_hand_0" in bench.hands() and bench.agent.degraded == ""
    assert bench.memory.node("human_hand_0")["source"] == "mediapipe"
    assert bench.memory.node("human_hand_0")["side"] == "right"
    height = in_world(np.array([[0.0, 0.0, DISTANCE]]))[0][2]
    assert abs(bench.place("human_hand_0")[2] - height) < 0.03


def test_what_only_looks_like_a_model_is_told(tmp_path: Path, make_bench: Callable[..., Bench]) -> None:
    file = str(archive(tmp_path / "stub.task", *ENTRIES))
    with pytest.raises(ConfigError, match="MediaPipe cannot use the model"):
        TasksLandmarker(Path(file), 0.5)
    bench = make_bench(model=file, runner="mediapipe")
    bench.show(wall(255), ticks=2)
    assert "MediaPipe cannot use the model" in bench.agent.degraded
