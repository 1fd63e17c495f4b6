"""Draws the figures of benchmarks/calibration and calibration_synthetic: those of section 4.2 of the CORTEX paper."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt

_AXES = ("x (mm)", "y (mm)", "z (mm)", "roll (deg)", "pitch (deg)", "yaw (deg)")


def draw(result: Mapping[str, Any], folder: Path, prefix: str = "calibration") -> list[Path]:
    """Write a PNG for each figure of which there are figures; the files, whose names begin with `prefix`."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
        "history": result["methods"] and _history(result["methods"]),
        "spread": result["methods"] and _spread(result["methods"]),
        "cubes": result["cubes"] and _elsewhere(result["cubes"], "cubes"),
        "layouts": result["layouts"] and _elsewhere(result["layouts"], "layout"),
    }
    files = []
    for name, figure in figures.items():
        if not figure:
            continue
        files.append(folder / f"{prefix}_{name}.png")
        figure.savefig(files[-1], bbox_inches="tight", dpi=130)
        plt.close(figure)
    return files


def _history(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Figure 5: the error during the optimisation, mean and 95 % confidence interval."""
    figure, axes = plt.subplots(figsize=(7, 4))
    for row in rows:
        means, halves = np.array(row["history"]).T
        (line,) = axes.plot(means, label=row["name"])
        axes.fill_between(range(len(means)), means - halves, means + halves, color=line.get_color(), alpha=0.2)
    axes.set(yscale="log", xlabel="iteration", ylabel="Equation 1, sign corrected")
    axes.legend()
    return figure


def _spread(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Figure 6: how the six values of the pose scatter around the truth."""
    figure, panels = plt.subplots(1, 6, figsize=(14, 3.2))
    for index, axes in enumerate(panels):
        scale = 1e3 if index < 3 else math.degrees(1.0)
        values = [scale * np.array(row["errors"])[:, index] for row in rows]
        axes.boxplot(values, showfliers=False)
        axes.set_xticks(range(1, len(rows) + 1), [row["name"] for row in rows], rotation=60)
        axes.set_title(_AXES[index])
    figure.tight_layout()
    return figure


def _elsewhere(rows: Sequence[Mapping[str, Any]], label: str) -> Any:
    """Figures 8a and 8b: the error from four other arm poses, beside that before the calibration."""
    figure, axes = plt.subplots(figsize=(7, 4))
    halves = [row.get("half_ci95_mm", 0.0) for row in rows]
    axes.bar([row["name"] for row in rows], [row["elsewhere_mm"] for row in rows], yerr=halves, capsize=3)
    before = np.mean([row["elsewhere_before_mm"] for row in rows])
    axes.axhline(before, color="red", linestyle="--", label="before")
    axes.set(xlabel=label, ylabel="mm, seen from four other arm poses")
    axes.legend()
    return figure
