"""What counts as gone, black, frozen and corrupt, and how often it is told: at times that the test gives."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from agents.cameras.condition import FROZEN, CameraCondition
from agents.drivers import SILENCE
from dsr.images.blobs import Frame

LOG = logging.getLogger("test.camera")
STEP = 0.1


@pytest.fixture
def condition(caplog: pytest.LogCaptureFixture) -> CameraCondition:
    caplog.set_level(logging.INFO, LOG.name)
    made = CameraCondition("cam", LOG)
    made.begin(0.0)
    return made


def seen(value: int, noise: int = 0) -> Frame:
    """A picture of this grey, or with a pattern that `noise` changes."""
    color = np.full((48, 64, 3), value, np.uint8)
    color[::2, ::2] += np.uint8(noise)
    return Frame(0.0, {"color": color}, {})


def test_a_camera_that_never_says_anything_is_told(condition: CameraCondition) -> None:
    assert condition.trouble(SILENCE) == "" and not condition.is_silent(SILENCE)
    assert condition.trouble(SILENCE + 1.0) == "no picture for 4 s" and condition.is_silent(SILENCE + 1.0)


def test_gone_and_back_are_told_once_each(condition: CameraCondition, caplog: pytest.LogCaptureFixture) -> None:
    assert condition.takes(seen(50), 1.0)
    for attempt in range(4):
        condition.lost("unplugged", 2.0 + attempt)
    assert condition.trouble(6.0) == "unplugged" and condition.counts == {"lost": 1}
    condition.begin(6.0)
    assert condition.trouble(6.1) == "unplugged"
    assert condition.takes(seen(51), 7.5)
    assert condition.trouble(7.6) == ""
    assert [record.getMessage() for record in caplog.records] == [
        "camera cam is gone: unplugged; it is tried again and again",
        "camera cam is back after 6.5 s",
    ]


def test_another_reason_is_told_too(condition: CameraCondition, caplog: pytest.LogCaptureFixture) -> None:
    condition.lost("unplugged", 1.0)
    condition.lost("no permission", 2.0)
    assert len(caplog.records) == 2 and condition.counts["lost"] == 1


def test_a_frozen_camera_shows_nothing_new(condition: CameraCondition) -> None:
    times = [STEP * number for number in range(40)]
    taken = [condition.takes(seen(80), at) for at in times]
    assert taken == [at < FROZEN for at in times]
    assert condition.counts == {"frozen": taken.count(False)}
    assert condition.frozen_for(times[-1]) == pytest.approx(times[-1])
    assert condition.takes(seen(80, noise=1), 4.0) and condition.frozen_for(4.0) == 0.0


def test_few_pictures_of_a_slow_camera_do_not_make_it_frozen(condition: CameraCondition) -> None:
    assert all(condition.takes(seen(80), 2.0 * number) for number in range(4))


def test_where_pictures_may_be_the_same_none_is_frozen() -> None:
    still = CameraCondition("cam", LOG, frozen=0.0)
    assert all(still.takes(seen(80), STEP * number) for number in range(100))


def test_black_pictures_go_on_and_are_told(condition: CameraCondition, caplog: pytest.LogCaptureFixture) -> None:
    assert all(condition.takes(seen(3), STEP * number) for number in range(50))
    assert "black" in condition.trouble(5.0) and condition.counts == {"black": 50}
    assert condition.takes(seen(90), 5.1) and condition.trouble(5.1) == ""
    assert [record.levelname for record in caplog.records] == ["WARNING", "INFO"]


def test_a_dark_pixel_row_or_a_single_black_picture_is_nothing(condition: CameraCondition) -> None:
    assert condition.takes(seen(3), 0.0) and condition.takes(seen(90), 0.1) and condition.trouble(0.2) == ""
    half = seen(90)
    half.arrays["color"][:24] = 0
    for number in range(30):
        half.arrays["color"][40, 40] = number
        condition.takes(half, 1.0 + STEP * number)
    assert "black" not in condition.trouble(4.0) and condition.counts["black"] == 1


def test_corrupt_pictures_are_counted_and_told_until_one_is_well(condition: CameraCondition) -> None:
    for _ in range(3):
        condition.corrupt("half a JPEG")
    assert condition.counts == {"corrupt": 3} and "half a JPEG" in condition.trouble(0.1)
    condition.takes(seen(70), 0.2)
    assert condition.trouble(0.3) == ""
