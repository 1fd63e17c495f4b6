"""The way through the model, with recorded landmarks, and all that can be wrong with its file and its packages."""

from __future__ import annotations

import json
import logging
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.hand_tracker import HandTrackerConfig
from agents.hand_tracker import agent as tracker_agent
from agents.hand_tracker.depth import depth_at
from agents.hand_tracker.landmarker import ModelFinder
from agents.hand_tracker.model.files import SHA256
from agents.hand_tracker.model.loading import load_landmarker
from agents.hand_tracker.skin import SkinFinder
from dsr.errors import ConfigError
from dsr.math3d import quaternions

from .conftest import RECORDED, Bench, RecordedLandmarker, in_world, palm_of, picture, tips_of

FRAMES = RECORDED["frames"]
ENTRIES = tuple(SHA256)


def finder(*frames: dict[str, Any], **config: Any) -> ModelFinder:
    return ModelFinder(HandTrackerConfig(**config), RecordedLandmarker(list(frames)))


@pytest.mark.parametrize("holes", [False, True], ids=["whole depth", "60 % holes"])
@pytest.mark.parametrize("frame", FRAMES, ids=["right", "two", "left"])
def test_landmarks_and_depth_give_points_in_space(frame: dict[str, Any], holes: bool) -> None:
    hands = finder(frame).find(picture(frame, holes=holes), None)
    assert [hand.side for hand in hands] == [hand["side"].lower() for hand in frame["hands"]]
    for hand, recorded in zip(hands, frame["hands"], strict=True):
        truth = np.array(recorded["truth_m"])
        assert np.linalg.norm(hand.palm.translation - palm_of(truth)) < 0.004
        assert hand.is_labelled and len(hand.tips) >= 4
        errors = [np.linalg.norm(point - tips_of(truth)[finger]) for finger, point in hand.tips.items()]
        assert max(errors) < 0.008


def test_a_fingertip_behind_something_is_not_measured() -> None:
    frame = FRAMES[0]
    image = picture(frame)
    x, y, z = frame["hands"][0]["truth_m"][8]
    u, v = (round(part / z * RECORDED["fx"] + RECORDED[centre]) for part, centre in ((x, "cx"), (y, "cy")))
    image.arrays["depth"][v - 15 : v + 16, u - 15 : u + 16] = z - 0.1
    (hand,) = finder(frame).find(image, None)
    assert 1 not in hand.tips and 2 in hand.tips


def tilted(frame: dict[str, Any], angle: float) -> dict[str, Any]:
    """A frame of whose hands the model tells another tilt than they have, about the x axis of the image."""
    turn = np.array(quaternions.to_matrix(quaternions.from_rotvec((angle, 0.0, 0.0))))
    hands = [{**hand, "world_landmarks": np.array(hand["world_landmarks"]) @ turn.T} for hand in frame["hands"]]
    return {**frame, "hands": hands}


@pytest.mark.parametrize("angle", [-0.35, 0.35])
def test_a_hand_of_which_the_model_tells_a_wrong_tilt_is_seen_whole(angle: float) -> None:
    truth = np.array(FRAMES[0]["hands"][0]["truth_m"])
    (right,) = finder(FRAMES[0]).find(picture(FRAMES[0]), None)
    (hand,) = finder(tilted(FRAMES[0], angle)).find(picture(FRAMES[0]), None)
    assert np.linalg.norm(hand.palm.translation - palm_of(truth)) < 0.004
    assert hand.palm.distance(right.palm)[1] < 0.1
    assert len(hand.tips) >= 4


def test_what_hides_a_hand_is_no_tilted_hand() -> None:
    """A steep board is in front of the hand, of which the model still tells where it is."""
    image = picture(FRAMES[0])
    rows = np.arange(480, dtype=np.float32)[:, None]
    image.arrays["depth"][:] = 0.1 + 1.2e-3 * rows
    assert finder(FRAMES[0]).find(image, None) == []


def test_the_depth_at_an_edge_is_that_of_one_of_both_surfaces() -> None:
    for near in range(1, 9):
        depth = np.full((3, 3), 1.0, np.float32)
        depth.flat[:near] = 0.5
        assert depth_at(depth, np.array([1.0, 1.0]), 1.0) in (0.5, 1.0)


def test_unsure_sides_are_left_open_and_sides_can_be_swapped() -> None:
    (hand,) = finder(FRAMES[0], least_side_score=1.0).find(picture(FRAMES[0]), None)
    assert hand.side == "unknown"
    (hand,) = finder(FRAMES[0], swap_sides=True).find(picture(FRAMES[0]), None)
    assert hand.side == "left"


def test_a_hand_without_depth_is_nowhere() -> None:
    image = picture(FRAMES[0])
    image.arrays["depth"][:] = 0.0
    assert finder(FRAMES[0]).find(image, None) == []


@pytest.mark.parametrize("strength", [-1.0, -5.0, -50.0, -1e200])
def test_a_hand_where_the_lens_shows_nothing_is_nowhere(strength: float) -> None:
    """The image of such a lens ends at some distance from the axis."""
    seen = picture(FRAMES[0])
    lens = {"distortion_model": "plumb_bob", "d1": strength, "d2": 0.0, "d3": 0.0, "d4": 0.0}
    for meta in (lens, {**lens, "cx": -1e5}):
        image = msgspec.structs.replace(seen, meta={**seen.meta, **meta})
        for one in (finder(FRAMES[0]), SkinFinder(HandTrackerConfig())):
            for hand in one.find(image, None):
                assert np.isfinite([*hand.palm.t, *np.ravel(list(hand.tips.values()))]).all()
    assert finder(FRAMES[0]).find(image, None) == []


def test_times_increase_even_if_a_camera_repeats_itself() -> None:
    landmarker = RecordedLandmarker(FRAMES[:1])
    mediapipe = ModelFinder(HandTrackerConfig(), landmarker)
    for _ in range(3):
        mediapipe.find(picture(FRAMES[0]), None)
    assert landmarker.times == [0, 1, 2]


def use(monkeypatch: pytest.MonkeyPatch, landmarker: RecordedLandmarker) -> None:
    monkeypatch.setattr(tracker_agent, "load_landmarker", lambda config: lambda: landmarker)


def test_the_tracker_writes_what_mediapipe_sees(
    make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    landmarker = RecordedLandmarker(FRAMES[1:2])
    use(monkeypatch, landmarker)
    bench = make_bench(model="hand_landmarker.task")
    bench.show(picture(FRAMES[1]), ticks=2)
    assert bench.hands() == ["human_hand_0", "human_hand_1"] and bench.agent.degraded == ""
    for name, recorded in zip(bench.hands(), FRAMES[1]["hands"], strict=True):
        node = bench.memory.node(name)
        assert (node["source"], node["side"]) == ("mediapipe", recorded["side"].lower())
        palm = in_world(palm_of(np.array(recorded["truth_m"]))[None])[0]
        assert np.linalg.norm(bench.place(name) - palm) < 0.004
    bench.runner.teardown()
    assert landmarker.closed


@pytest.mark.parametrize("error", [RuntimeError, ValueError, TimeoutError, IndexError])
def test_a_model_that_fails_while_running_is_given_up(
    error: type[Exception],
    make_bench: Callable[..., Bench],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    landmarker = RecordedLandmarker(FRAMES[:1], error("graph has errors"))
    use(monkeypatch, landmarker)
    bench = make_bench(model="hand_landmarker.task")
    bench.show(picture(FRAMES[0]), ticks=3)
    assert "graph has errors" in bench.agent.degraded and landmarker.closed and len(landmarker.times) == 1
    assert len([record for record in caplog.records if record.levelno >= logging.WARNING]) == 1


def archive(file: Path, *entries: str) -> Path:
    with zipfile.ZipFile(file, "w") as model:
        for entry in entries:
            model.writestr(entry, b"TFL3" * 100)
    return file


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: folder / "missing.task", "no model file"),
        (lambda folder: folder, "no model file"),
        (lambda folder: _written(folder / "empty.task", b""), "is empty"),
        (lambda folder: _written(folder / "half.task", b"PK\x03\x04 half a download"), "is corrupt"),
        (lambda folder: _damaged(archive(folder / "bits.task", *ENTRIES)), "is corrupt"),
        (lambda folder: _damaged(archive(folder / "odd.task", *ENTRIES), b"PK\x01\x02", 10, b"\x40"), "is corrupt"),
        (lambda folder: _damaged(archive(folder / "key.task", *ENTRIES), b"PK\x01\x02", 8, b"\x01"), "is corrupt"),
        (lambda folder: _damaged(deflated(folder / "z.task"), ENTRIES[0].encode(), 40, b"\xff" * 20), "is corrupt"),
        (lambda folder: folder / f"{'long' * 80}.task", "cannot be read"),
        (lambda folder: archive(folder / "face.task", "face_detector.tflite"), "lacks hand_detector.tflite"),
    ],
    ids=[
        "missing",
        "folder",
        "empty",
        "truncated",
        "damaged",
        "method",
        "encrypted",
        "deflated",
        "long",
        "another model",
    ],
)
def test_a_wrong_model_file_is_told_once_and_skin_colour_must_do(
    make: Callable[[Path], Path],
    message: str,
    tmp_path: Path,
    make_bench: Callable[..., Bench],
    caplog: pytest.LogCaptureFixture,
) -> None:
    file = str(make(tmp_path))
    with pytest.raises(ConfigError, match=message):
        load_landmarker(HandTrackerConfig(model=file))
    bench = make_bench(model=file)
    assert bench.agent.degraded == ""  # nobody has sent images yet
    bench.show(picture(FRAMES[0]), ticks=3)
    assert message in bench.agent.degraded
    (record,) = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert message in record.getMessage() and "skin colour" in record.getMessage()


@pytest.mark.parametrize(
    ("runner", "package", "extra"), [("litert", "ai_edge_litert", "hands"), ("mediapipe", "mediapipe", "mediapipe")]
)
def test_without_its_package_a_runner_says_which_extra_brings_it(
    runner: Any, package: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (package, "ai_edge_litert.interpreter"):
        monkeypatch.setitem(sys.modules, module, None)
    config = HandTrackerConfig(model=str(archive(tmp_path / "good.task", *ENTRIES)), runner=runner)
    with pytest.raises(ConfigError, match=f"extra `{extra}`"):
        load_landmarker(config)()


def test_a_package_that_cannot_be_used_is_a_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.split(".")[0] == "mediapipe"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "mediapipe", json)
    config = HandTrackerConfig(model=str(archive(tmp_path / "good.task", *ENTRIES)), runner="mediapipe")
    with pytest.raises(ConfigError, match="mediapipe cannot be imported"):
        load_landmarker(config)()


@pytest.mark.parametrize(
    ("config", "degraded", "told"),
    [
        ({}, "", "the model was not fetched; `dsr hands fetch`"),
        ({"finder": "colour"}, "", "by skin colour and depth: as configured"),
        ({"finder": "model"}, "no model file", ""),
    ],
    ids=["auto", "colour", "model"],
)
def test_how_hands_are_found_without_a_fetched_model_is_told(
    config: dict[str, Any],
    degraded: str,
    told: str,
    make_bench: Callable[..., Bench],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with caplog.at_level(logging.INFO):
        bench = make_bench(**config)
    assert told in caplog.text
    bench.show(picture(FRAMES[0]))
    assert degraded in bench.agent.degraded and bool(bench.agent.degraded) is bool(degraded)


def _written(file: Path, content: bytes) -> Path:
    file.write_bytes(content)
    return file


def deflated(file: Path) -> Path:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as model:
        for entry in ENTRIES:
            model.writestr(entry, bytes(range(256)) * 20)
    return file


def _damaged(file: Path, after: bytes = b"", offset: int = 80, wrong: bytes = b"\x00\xff\x00\xff") -> Path:
    content = bytearray(file.read_bytes())
    begin = content.index(after) + offset
    content[begin : begin + len(wrong)] = wrong
    file.write_bytes(bytes(content))
    return file
