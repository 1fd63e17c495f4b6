"""Stamps of other clocks on ours: by the pictures that took least to arrive, and as if a recording began now."""

from __future__ import annotations

import numpy as np
import pytest

from agents.cameras.device_clock import DeviceClock, RecordingClock


def test_the_offset_is_that_of_the_picture_that_came_fastest() -> None:
    clock, rng = DeviceClock(), np.random.default_rng(1)
    delays = 0.01 + rng.exponential(0.02, 300)
    errors = [clock.ours(50.0 + k / 30, 1000.0 + k / 30 + delay) - (1000.0 + k / 30) for k, delay in enumerate(delays)]
    assert max(errors[100:]) < 0.013 and min(errors) >= 0.01


def test_a_clock_that_drifts_is_followed() -> None:
    for drift in (5e-5, -5e-5):
        clock = DeviceClock()
        errors = [clock.ours(k * (1 + drift), k + 0.01) - k for k in range(7200)]
        assert np.abs(errors).max() < 0.012


def test_a_device_that_begins_anew_is_taken_anew() -> None:
    clock = DeviceClock()
    assert clock.ours(5000.0, 100.0) == pytest.approx(100.0)
    assert clock.ours(0.5, 110.0) == pytest.approx(110.0)
    assert clock.ours(0.6, 110.1) == pytest.approx(110.1)


def test_a_recording_begins_now_and_again_after_its_end() -> None:
    clock = RecordingClock(0.1)
    due = [clock.ours(told, 100.0) for told in (7.0, 7.1, 7.3, 7.0, 7.1)]
    assert due == pytest.approx([100.0, 100.1, 100.3, 100.4, 100.5])
