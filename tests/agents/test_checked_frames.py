"""Drivers that fail and give what is no frame: nothing is raised, all is counted, and the next good frame counts."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from agents.camera_feed import CameraFeed
from agents.cameras.errors import CorruptFrameError
from agents.cameras.trial import Trial, picture_of
from agents.checked_frames import CheckedFrames
from agents.drivers import SILENCE
from dsr import Frame, LocalNetwork, ManualClock, Memory
from dsr.images.frame_reader import FrameReader
from dsr.network.keys import Keys
from dsr.vocabulary.intrinsics import read_intrinsics

LENS = {"fx": 60.0, "fy": 60.0, "cx": 32.0, "cy": 24.0}
COLOR, DEPTH = np.full((48, 64, 3), 90, np.uint8), np.ones((48, 64), np.float32)
LOG = logging.getLogger("test")


class Scripted:
    """A driver that gives, or raises, what is next."""

    trouble = ""
    counts: Mapping[str, int] = {"corrupt": 2}

    def __init__(self, *script: Any) -> None:
        self.script = list(script)

    def frame(self) -> Any:
        step = self.script.pop(0) if self.script else None
        if isinstance(step, Exception):
            raise step
        return step

    def close(self) -> None:
        """Nothing is held."""


def good(stamp: float, **meta: Any) -> Frame:
    return Frame(stamp, {"color": COLOR, "depth": DEPTH}, {**LENS, **meta})


@pytest.mark.parametrize(
    ("bad", "what", "said"),
    [
        (RuntimeError("the library is gone"), "failed", "RuntimeError: the library is gone"),
        ("a picture", "malformed", "a str"),
        (Frame(float("nan"), {"color": COLOR}, {}), "malformed", "stamped nan"),
        (Frame(1.0, {"depth": DEPTH.astype(np.float16)}, {}), "malformed", "float16"),
        (Frame(1.0, {"color": None}, {}), "malformed", "NoneType"),  # type: ignore[dict-item]
        (Frame(1.0, {"color": COLOR}, {"fx": np.float32(60.0)}), "malformed", "numpy.float32"),  # type: ignore[dict-item]
        (Frame(1.0, {"color": COLOR}, None), "malformed", "Expected `object`, got `None`"),  # type: ignore[arg-type]
        (good(1.0, fx=True), "malformed", "got `bool`"),
        (Frame(1.0, {5: COLOR}, {}), "malformed", "Expected `str`, got `int`"),  # type: ignore[dict-item]
        (Frame(1.0, {"color": COLOR[None, None]}, {}), "malformed", "5 axes"),
        (good(0.4), "out of order", "0.600 s before"),
    ],
)
def test_what_cannot_be_used_is_dropped_and_counted(
    bad: Any, what: str, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    clock = ManualClock()
    frames = CheckedFrames(Scripted(good(1.0), bad, bad, good(1.1)), clock, LOG, "cam")
    assert frames.frame() is not None and frames.trouble == ""
    assert frames.frame() is None and frames.frame() is None
    assert said in frames.trouble
    assert frames.counts == {"corrupt": 2, what: 2}
    assert len(caplog.records) == 1
    after = frames.frame()
    assert after is not None and after.stamp == 1.1 and frames.trouble == ""


class Gone(Scripted):
    """A driver that cannot even tell how it does."""

    def __getattribute__(self, name: str) -> Any:
        if name in ("trouble", "counts"):
            raise OSError("no such device")
        return super().__getattribute__(name)


def test_a_driver_that_fails_to_tell_how_it_does_is_in_trouble() -> None:
    frames = CheckedFrames(Gone("a picture"), ManualClock(), LOG, "cam")
    assert frames.frame() is None
    assert frames.trouble == "its driver failed: OSError: no such device"
    assert frames.counts == {"malformed": 1}


def test_a_clock_that_was_set_back_is_taken_anew() -> None:
    clock = ManualClock()
    frames = CheckedFrames(Scripted(*map(good, (100.0, 10.0, 11.0, 12.0, 11.5))), clock, LOG, "cam")
    assert frames.frame() is not None and frames.frame() is None
    clock.advance(SILENCE)
    assert [frame and frame.stamp for frame in (frames.frame(), frames.frame(), frames.frame())] == [11.0, 12.0, None]


def test_a_feed_lives_on_and_tells_wrong_intrinsics() -> None:
    clock = ManualClock()
    network = LocalNetwork(clock)
    memory = Memory("g", "a", transport=network.connect("a"), clock=clock)
    reader = FrameReader(network.connect("b"), Keys("g").blob("cam"))
    wrong = [good(2.0, fx=-60.0), good(2.1, distortion_model="equidistant", d1=0.1), good(2.2, cx="left")]
    feed = CameraFeed(memory, "cam", Scripted(OSError("unplugged"), *wrong, good(3.0)), LOG)
    assert not feed.forward() and "unplugged" in feed.trouble
    for said in ("fx, fy >= 1 px", "expected 4 finite numbers", "cx missing"):
        assert feed.forward() and said in feed.trouble
        network.deliver()
        assert reader.latest() is not None  # nothing is lost
    assert "cam" not in memory
    assert feed.forward() and feed.trouble == ""
    intrinsics = read_intrinsics(memory.node("cam"))
    assert intrinsics is not None and intrinsics.fx == 60.0
    memory.close()


def test_a_trial_tells_why_nothing_comes() -> None:
    trial = Trial(Scripted(RuntimeError("the library is gone")))
    assert trial.look(1.0) is None
    findings = trial.findings()
    assert (findings.frames, findings.counts["failed"]) == (0, 1) and "the library is gone" in findings.trouble


def test_a_trial_tells_a_lens_that_shows_nothing_in_part_of_its_picture() -> None:
    lens = {"distortion_model": "plumb_bob", "d1": -50.0, "d2": 9000.0, "d3": 3.0, "d4": 4.0}
    trial = Trial(Scripted(good(1.0, **lens)))
    trial.look(1.0)
    assert any("the lens shows nothing in" in said for said in trial.findings().missing)


@pytest.mark.parametrize(
    "arrays",
    [
        {}, {"color": COLOR[:0]}, {"color": COLOR[..., :2]}, {"color": COLOR.astype(np.float32)},
        {"color": COLOR, "depth": DEPTH[::2, ::2]}, {"depth": DEPTH[..., None]},
    ],
)  # fmt: skip
def test_a_frame_without_a_picture_is_a_clear_error(arrays: dict[str, Any]) -> None:
    with pytest.raises(CorruptFrameError, match="without a picture"):
        picture_of(Frame(1.0, arrays, {}))
