"""Draws how honest the speakers are: coverage of regions, calibration of relations and actions, and log scores."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt

from benchmarks.honesty.answers import calibration
from benchmarks.honesty.moments import SPEAKERS, RunScores, Seen
from benchmarks.honesty.summary import Report, answers_of, regions

_COLORS = {"belief": "#c8102e", "one world": "#e0a030", "percept": "#1f4e79"}
_LINES: dict[Seen, str] = {"seen": "-", "unseen": "--"}
_STYLE = {"figure.dpi": 110, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False}


def draw_pictures(runs: Sequence[RunScores], report: Report, folder: Path) -> list[Path]:
    """Write three PNGs into a folder; their files."""
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(_STYLE):
        return [
            _saved(_coverage(runs), folder / "honesty_coverage.png"),
            _saved(_calibration(runs), folder / "honesty_calibration.png"),
            _saved(_log_scores(report), folder / "honesty_log_scores.png"),
        ]


def _coverage(runs: Sequence[RunScores]) -> Any:
    """How often regions hold the truth, over their mass."""
    figure, axes = plt.subplots(figsize=(5, 4.5))
    axes.plot([0, 1], [0, 1], color="black", linestyle=":", label="honest")
    masses = np.linspace(0.0, 0.999, 200)
    for speaker in SPEAKERS:
        for seen, line in _LINES.items():
            found = np.array(regions(runs, speaker, seen))
            if len(found):
                shares = [float(np.mean(found <= mass)) for mass in masses]
                axes.plot(masses, shares, line, color=_COLORS.get(speaker), label=f"{speaker}, {seen}")
    axes.set(xlabel="mass of the region", ylabel="share that holds the truth", xlim=(0, 1), ylim=(0, 1))
    axes.legend()
    return figure


def _calibration(runs: Sequence[RunScores]) -> Any:
    """How often is so what is told, over its probability."""
    figure, axes = plt.subplots(figsize=(5, 4.5))
    axes.plot([0, 1], [0, 1], color="black", linestyle=":", label="honest")
    for kind in dict.fromkeys(told.kind for run in runs for told in run.answers):
        found = calibration(answers_of(runs, kind))
        axes.plot([one.told for one in found], [one.is_so for one in found], "o-", label=kind, alpha=0.8)
    axes.set(xlabel="probability told", ylabel="share that is so", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
    axes.legend()
    return figure


def _log_scores(report: Report) -> Any:
    """Log scores by family, less is better."""
    families = list(dict.fromkeys(scores.family for scores in report.places))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 0.42 * len(families) + 1.2), sharey=True)
    thick = 0.8 / len(SPEAKERS)
    sides: tuple[tuple[Any, Seen], ...] = ((left, "seen"), (right, "unseen"))
    for axes, seen in sides:
        for number, speaker in enumerate(SPEAKERS):
            found = {one.family: one for one in report.places if one.speaker == speaker and one.seen == seen}
            shift = thick * (number - 0.5 * (len(SPEAKERS) - 1))
            places = [place + shift for place, family in enumerate(families) if family in found]
            values = [found[family].log_score for family in families if family in found]
            errors = [found[family].log_score_error or 0.0 for family in families if family in found]
            axes.barh(places, values, thick, xerr=errors, color=_COLORS.get(speaker), label=speaker)
        axes.set(title=f"{seen}: nats, less is better")
    left.set_yticks(range(len(families)), families)
    left.invert_yaxis()
    figure.legend(*left.get_legend_handles_labels(), loc="lower center", ncols=len(SPEAKERS))
    return figure


def _saved(figure: Any, file: Path) -> Path:
    figure.savefig(file, bbox_inches="tight")
    plt.close(figure)
    return file
