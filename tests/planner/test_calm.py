"""When a scene counts as left alone: nothing comes, goes, or moves by more than noise."""

from __future__ import annotations

from planner.monitor import have_moved

HERE = {"a": (0.3, 0.0, 0.02), "b": (0.4, 0.0, 0.02)}


def test_noise_is_no_motion() -> None:
    assert not have_moved(HERE, {**HERE, "a": (0.303, 0.002, 0.02)}, 0.01)


def test_what_comes_goes_or_moves_does_not_leave_it_alone() -> None:
    assert have_moved(HERE, {**HERE, "a": (0.32, 0.0, 0.02)}, 0.01)
    assert have_moved(HERE, {"a": HERE["a"]}, 0.01)
    assert have_moved(HERE, {**HERE, "c": (0.5, 0.0, 0.02)}, 0.01)
