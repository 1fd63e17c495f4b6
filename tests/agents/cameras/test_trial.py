"""What a trial finds of a camera: rates, delays, depth, intrinsics, and what agents will lack."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from agents.cameras.errors import CorruptFrameError
from agents.cameras.trial import CameraFindings, Trial, picture_of
from dsr.images.blobs import Frame

META = {"fx": 32.0, "fy": 32.0, "cx": 31.5, "cy": 23.5}


class Camera:
    """A driver that gives these frames, one at each call."""

    def __init__(self, frames: Iterable[Frame | None]) -> None:
        self._frames = iter(frames)
        self.trouble = "dusty"
        self.counts = {"passed over": 3}

    def frame(self) -> Frame | None:
        return next(self._frames, None)

    def close(self) -> None:
        pass


def shot(stamp: float, depth: float | None = 2.0, meta: dict[str, float] | None = None) -> Frame:
    arrays: dict[str, np.ndarray] = {"color": np.full((48, 64, 3), 99, np.uint8)}
    if depth is not None:
        arrays["depth"] = np.full((48, 64), depth, np.float32)
        arrays["depth"][:24] = 0.0
    return Frame(stamp, arrays, dict(META if meta is None else meta))


def found(frames: Iterable[Frame | None], delay: float = 0.03) -> CameraFindings:
    frames = list(frames)
    trial = Trial(Camera(frames))
    for frame in frames:
        trial.look(delay + (frame.stamp if frame else 0.0))
    return trial.findings()


def test_rates_count_what_was_passed_over() -> None:
    findings = found([shot(0.1 * k) if k % 2 else None for k in range(21)])
    assert findings.frames == 10 and findings.rate_hz == pytest.approx((9 + 3) / 1.8)
    assert findings.delay_s == pytest.approx(0.03)
    assert (findings.width, findings.height) == (64, 48)
    assert findings.counts == {"passed over": 3} and findings.trouble == "dusty"


def test_depth_and_intrinsics_are_told() -> None:
    findings = found([shot(1.0)])
    assert findings.depth_known == 0.5 and findings.depth_m == (2.0, 2.0, 2.0)
    assert findings.intrinsics is not None and findings.intrinsics.fx == 32.0
    assert findings.fov_deg == pytest.approx(2 * np.degrees(np.arctan(31.5 / 32.0)))
    assert findings.rate_hz is None and findings.missing == []


@pytest.mark.parametrize(
    ("frame", "delay", "said"),
    [
        (shot(1.0, depth=None), 0.0, "no depth"),
        (shot(1.0, depth=0.0), 0.0, "depth is known nowhere"),
        (shot(1.0, depth=700.0), 0.0, "in millimetres"),
        (shot(1.0, meta={}), 0.0, "intrinsics fx, fy, cx, cy missing"),
        (shot(1.0), -5.0, "5.00 s ahead"),
        (shot(1.0), 3.0, "come 3.00 s after"),
        (Frame(1.0, {"depth": np.ones((48, 64), np.float32)}, dict(META)), 0.0, "expected a colour image"),
        (Frame(1.0, {}, {}), 0.0, "expected a colour image"),
    ],
)
def test_what_agents_will_lack(frame: Frame, delay: float, said: str) -> None:
    findings = found([frame], delay)
    assert any(said in text for text in findings.missing), findings.missing


def test_nothing_came() -> None:
    findings = found([None, None])
    assert findings.frames == 0 and findings.width == 0 and findings.missing == []


def test_the_picture_shows_depth_beside_colour() -> None:
    assert picture_of(shot(1.0, depth=None)).shape == (48, 64, 3)
    picture = picture_of(shot(1.0))
    assert picture.shape == (48, 128, 3)
    assert (picture[:24, 64:] == 0).all() and (picture[24:, 64:] != 0).any()
    with pytest.raises(CorruptFrameError):
        picture_of(Frame(1.0, {}, {}))


def test_an_axis_beside_the_picture_is_told() -> None:
    assert not any("optical axis" in text for text in found([shot(1.0)]).missing)
    (text,) = (text for text in found([shot(1.0, meta={**META, "cx": 640.0})]).missing if "optical axis" in text)
    assert "another camera or size" in text
