"""The figures of `python -m benchmarks.surprise`, on small numbers."""

from __future__ import annotations

from functools import partial

from benchmarks import surprise


def test_it_is_quiet_also_with_false_percepts() -> None:
    found = surprise.quiet(0.01, seed=3)
    assert found["alarms"] == found["alarms_with_false_percepts"] == []
    assert found["ms_per_tick"] > 0.0


def test_moves_are_counted_and_timed() -> None:
    row = surprise.trials(partial(surprise._moved, 0.015), 12, seed=1)
    assert row["in_time"] == row["noticed"] == 1.0
    assert 0.15 < row["median_s"] <= row["p95_s"] <= row["max_s"] <= surprise.IN_TIME
    assert surprise.trials(partial(surprise._moved, 0.002), 6, seed=1)["median_s"] is None


def test_what_is_required() -> None:
    row = {"kind": "move", "size": "15 mm", "in_time": 1.0}
    quiet: dict[str, list[str]] = {"alarms": [], "alarms_with_false_percepts": []}
    assert surprise.holds({"quiet": quiet, "trials": [row]})
    assert not surprise.holds({"quiet": quiet, "trials": [{**row, "in_time": 0.99}]})
    assert not surprise.holds({"quiet": {**quiet, "alarms": ["cube_1: why"]}, "trials": [row]})
