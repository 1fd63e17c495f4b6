"""What sessions of benchmarks/calibration come to: targets, tables, CSV files and the figures of the paper."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.calibration_scene import LAYOUTS
from benchmarks.calibration_synthetic import SUCCESS, TARGET, histories
from dsr.vocabulary.calibration import DEFAULT_METHOD, method_names

PARTS = ("trials", "cubes", "layouts", "mixed")
CASES = ("one_moved", "two_moved", "one_flipped", "bumped_and_one_moved", "all_moved_alike")
NEEDED = 48 / 50
"""Share of the runs of each case that must be decided rightly."""
SIX = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg")

_KEYS = (
    *("part", "case", "seed", "sensor", "metres", "radians", "times", "recovery", "elsewhere", "elsewhere_before"),
    *("right", "views", "seconds"),
)

Row = dict[str, Any]


def cases(part: str) -> Sequence[str]:
    """What is varied."""
    return {
        "trials": ("four",),
        "cubes": tuple(str(count) for count in range(1, 7)),
        "layouts": tuple(LAYOUTS),
        "mixed": CASES,
    }[part]


def holds(rows: Sequence[Row]) -> bool:
    """Whether all that was measured is as good as it must be."""
    trials = [row for row in rows if row["part"] == "trials"]
    by_case = [[row for row in rows if row["case"] == case] for case in CASES]
    enough = all(np.mean([row["right"] for row in runs]) >= NEEDED for runs in by_case if runs)
    return bool(enough and all(row["success"] for row in trials) and _is_near(trials))


def _is_near(trials: Sequence[Row]) -> bool:
    """Whether the poses are as near, by the medians, and found as quickly as they must be."""
    if not trials:
        return True
    metres, radians, seconds = TARGET
    times = [row["methods"][DEFAULT_METHOD]["seconds"] for row in trials if row["methods"]]
    errors = np.median([(row["metres"], row["radians"]) for row in trials], axis=0)
    return bool((errors <= (metres, radians)).all() and times and np.mean(times) <= seconds)


def report(console: Console, rows: Sequence[Row]) -> None:
    """Print a table for each part."""
    for title, heading, lines in (_trials_table(rows), _survey_table(rows), _mixed_table(rows)):
        table = Table(title=title)
        for name in heading:
            table.add_column(name, justify="left" if name == heading[0] else "right")
        for line in lines:
            table.add_row(*line)
        if lines:
            console.print(table)


_Figures = tuple[str, tuple[str, ...], list[list[str]]]


def _trials_table(rows: Sequence[Row]) -> _Figures:
    heading = ("method", "right", "adopted", "of these wrong", "median mm", "95 %", "median deg", "95 %", "CPU ms")
    trials = [row for row in rows if row["part"] == "trials"]
    lines = []
    if trials:
        times = [row["recovery"] for row in trials if row["recovery"] is not None]
        text = f"{np.median(times):.1f} s (95 %: {np.quantile(times, 0.95):.1f} s) after the bump" if times else "never"
        errors = np.array([(row["metres"], row["radians"]) for row in trials])
        right = f"{sum(row['success'] for row in trials)}/{len(trials)}"
        adopted = sum(row["times"] == 1 for row in trials)
        lines.append(["the system", right, str(adopted), "", *_spread(errors), text])
    for method in method_names():
        found = [row["methods"][method] for row in trials if row["methods"]]
        if found:
            errors = np.array([one["distance"] for one in found])
            good = (errors < SUCCESS).all(axis=1)
            adopted_ones = np.array([one["adopted"] for one in found])
            milliseconds = f"{1e3 * np.mean([one['seconds'] for one in found]):.1f}"
            wrong = str(int((adopted_ones & ~good).sum()))
            counts = [f"{good.sum()}/{len(trials)}", str(int(adopted_ones.sum())), wrong]
            lines.append([method, *counts, *_spread(errors), milliseconds])
    median, most = _views(trials)
    return f"{len(trials)} bumps, four cubes; decided by {median} view(s), at most {most}", heading, lines


def _views(rows: Sequence[Row]) -> list[str]:
    """Median and greatest number of views that decisions took; of no decisions a dash."""
    counts = [count for row in rows for count in row.get("views", ())]
    return [f"{np.median(counts):g}", str(max(counts))] if counts else ["-", "-"]


def _spread(errors: Any) -> list[str]:
    metres, radians = errors[:, 0], errors[:, 1]
    figures = (1e3 * np.median(metres), 1e3 * np.quantile(metres, 0.95))
    angles = (math.degrees(np.median(radians)), math.degrees(np.quantile(radians, 0.95)))
    return [f"{value:.2f}" for value in (*figures, *angles)]


def _survey_table(rows: Sequence[Row]) -> _Figures:
    heading = ("case", "sessions", "elsewhere mm", "95 %", "before", "told weak")
    lines = []
    for part in ("cubes", "layouts"):
        for case in cases(part):
            runs = [row for row in rows if row["case"] == case and row.get("elsewhere") is not None]
            if runs:
                after, before = (
                    1e3 * np.array([row[key] for row in runs]) for key in ("elsewhere", "elsewhere_before")
                )
                weak = sum("geometry is weak" in row["told"] for row in runs)
                figures = (after.mean(), np.quantile(after, 0.95), before.mean())
                unit = " cube(s)" if part == "cubes" else " square"
                lines.append([f"{case}{unit}", str(len(runs)), *(f"{value:.2f}" for value in figures), str(weak)])
    return "Percepts beside beliefs, from four other arm poses; mount measured by hand", heading, lines


def _mixed_table(rows: Sequence[Row]) -> _Figures:
    heading = ("case", "right", "views, median", "most", "seeds that are not")
    lines = []
    for case in CASES:
        runs = [row for row in rows if row["case"] == case]
        if runs:
            wrong = ", ".join(str(row["seed"]) for row in runs if not row["right"])
            lines.append([case, f"{sum(row['right'] for row in runs)}/{len(runs)}", *_views(runs), wrong])
    return "Decisions", heading, lines


def draw(rows: Sequence[Row], folder: Path) -> None:
    """CSV of all sessions and of each figure, and the figures of the paper as PNG."""
    figures = _figures(rows)
    _write_csv(rows, figures, folder)
    if not find_spec("matplotlib"):
        Console(stderr=True).print("nothing was drawn without matplotlib: pip install 'dsr-memory\\[bench]'")
        return
    from benchmarks.calibration_plots import draw as draw_figures

    draw_figures(figures, folder)


def _figures(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """What the figures show: by method, by number of cubes, by layout."""
    trials = [row["methods"] for row in rows if row["part"] == "trials" and row["methods"]]
    methods = [
        {
            "name": method,
            "history": histories([one[method]["history"] for one in trials]),
            "errors": [one[method]["error"] for one in trials],
        }
        for method in (method_names() if trials else ())
    ]
    return {"methods": methods, **{part: _elsewhere(rows, part) for part in ("cubes", "layouts")}}


def _elsewhere(rows: Sequence[Row], part: str) -> list[Row]:
    """Mean, half its 95 % confidence interval, and mean before, in each case."""
    found = []
    for case in cases(part):
        runs = [row for row in rows if (row["part"], row["case"]) == (part, case) and row.get("elsewhere") is not None]
        if runs:
            after = 1e3 * np.array([row["elsewhere"] for row in runs])
            found.append({
                "name": case, "sessions": len(runs), "elsewhere_mm": float(after.mean()),
                "half_ci95_mm": 1.96 * float(after.std()) / math.sqrt(len(runs)),
                "elsewhere_before_mm": 1e3 * float(np.mean([row["elsewhere_before"] for row in runs])),
            })  # fmt: skip
    return found


def _write_csv(rows: Sequence[Row], figures: Mapping[str, list[Row]], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    scale = np.array([1e3] * 3 + [math.degrees(1.0)] * 3)
    tables: dict[str, list[list[Any]]] = {
        "sessions": [list(_KEYS), *([row.get(key, "") for key in _KEYS] for row in rows)],
        "history": [["method", "iteration", "mean", "half_ci95"]]
        + [[one["name"], step, *values] for one in figures["methods"] for step, values in enumerate(one["history"])],
        "spread": [["method", "trial", *SIX]]
        + [[m["name"], trial, *(scale * error)] for m in figures["methods"] for trial, error in enumerate(m["errors"])],
        **{part: [list(figures[part][0]), *(list(one.values()) for one in figures[part])]
           for part in ("cubes", "layouts") if figures[part]},
    }  # fmt: skip
    for name, lines in tables.items():
        if len(lines) > 1:
            with (folder / f"calibration_{name}.csv").open("w", encoding="utf-8", newline="") as stream:
                csv.writer(stream).writerows(lines)
