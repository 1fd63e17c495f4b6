"""The figures of `python -m benchmarks.calibration_synthetic`, on few trials."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import calibration_synthetic as calibration
from benchmarks.calibration_scene import DEPTH, LAYOUTS, looking, make_trial, scattered, square


def test_the_default_method_succeeds_from_far_off_with_flips_and_with_biased_depth() -> None:
    row = calibration.row("plain", lambda rng: make_trial(rng, square(0.1)), 8, seed=1)
    assert (row["successes"], row["adopted"]) == (8, 8)
    assert 10.0 * row["elsewhere_mm"] < 20.0 < row["elsewhere_before_mm"]
    assert row["within_3_sigma"] > 0.95 and len(row["errors"]) == 8
    assert row["history"][-1][0] < 0.1 * row["history"][0][0]
    deep = calibration.row("deep", lambda rng: make_trial(rng, square(0.1), depth=DEPTH), 8, seed=1)
    assert deep["successes"] >= 7
    flipped = calibration.row("flipped", lambda rng: make_trial(rng, scattered(rng, 6), flipped=0.15), 8, seed=1)
    assert flipped["successes"] >= 7


def test_clusters_are_weak_and_covering_layouts_are_not() -> None:
    rows = [
        calibration.row(name, lambda rng, half=half: make_trial(rng, square(half)), 2, seed=0)  # type: ignore[misc]
        for name, half in LAYOUTS.items()
    ]
    assert rows[0]["weak"] == 2 and all(row["weak"] == 0 for row in rows[1:])
    assert [row["condition"] for row in rows] == sorted((row["condition"] for row in rows), reverse=True)


def test_one_seed_gives_one_scene() -> None:
    first, second = (make_trial(np.random.default_rng(4), square(0.1)) for _ in range(2))
    assert first.sightings == second.sightings and first.believed == second.believed
    assert first.error_elsewhere(first.truth) == pytest.approx(0.0, abs=1e-12)


def test_cameras_look_at_the_cubes() -> None:
    middle = looking((0.1, 0.2, 0.5)).inverse().apply((0.35, 0.0, 0.02))
    assert middle == pytest.approx((0.0, 0.0, math.dist((0.1, 0.2, 0.5), (0.35, 0.0, 0.02))))


def test_what_is_required_and_the_tables(tmp_path: Path) -> None:
    result = calibration.measure(1, seed=0)
    best = result["methods"][0]
    best.update(successes=1, adopted=1, median_mm=1.9, median_deg=0.1, mean_ms=19.0)
    assert calibration.holds(result)
    for change in ({"successes": 0}, {"adopted": 0}, {"median_mm": 2.1}, {"median_deg": 0.21}, {"mean_ms": 21.0}):
        assert not calibration.holds({**result, "methods": [{**best, **change}]})
    files = calibration.write_csv(result, tmp_path)
    rows = list(csv.reader((tmp_path / "synthetic_cubes.csv").open()))
    assert len(files) == 7 and [row[0] for row in rows] == ["cubes", "1", "2", "3", "4", "5", "6"]


def test_plots(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from benchmarks.calibration_plots import draw

    files = draw(calibration.measure(2, seed=0), tmp_path)
    assert len(files) == 4 and all(file.stat().st_size > 1000 for file in files)
