"""Corners of rendered tags: their errors are what they are told to be, and smaller than those of a detector."""

from __future__ import annotations

import pytest

from benchmarks.corners import corner_rows


def test_corners_read_by_edges_are_as_exact_as_told_and_better_than_a_detectors() -> None:
    rows = {row["method"]: row for row in corner_rows([0.4], trials=12, seed=1, blur=0.0)}
    ours, detector = rows["ours"], rows["OpenCV, apriltag"]
    assert ours["found"] == ours["read"] == 12 and detector["read"] == 0
    assert 0.3 < ours["over_told"] < 1.5
    assert ours["rms_px"] < detector["rms_px"]
    assert ours["side_px"] == pytest.approx(49, abs=6)


def test_what_is_not_found_has_no_error() -> None:
    assert [(row["found"], row["rms_px"]) for row in corner_rows([5.0], trials=2, seed=1, blur=1.0)] == [(0, None)] * 3
