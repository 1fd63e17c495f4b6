"""Draws what was measured: one PNG a subject, with peers and targets in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.ticker import FuncFormatter

from benchmarks import cascade, join, latency, throughput, world_cascade
from benchmarks.curves import file_for
from benchmarks.rows import Row, number
from benchmarks.session import Findings

_OURS, _OTHERS = "#c8102e", ("#1f4e79", "#2e8b57", "#d98e04", "#7b4ea3", "#6c757d", "#17a2b8")
_MET, _MISSED, _TARGET = "#2e8b57", "#c8102e", {"color": "black", "linestyle": ":", "linewidth": 1.2}
_STYLE = {"figure.dpi": 130, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False}
_TIMES = (0.01, 0.1, 0.5, 1, 2, 10)
_LATENCY_TARGETS = (latency.SPECS["attribute"].p50.target, latency.SPECS["attribute"].p99.target)


def draw(findings: Findings, folder: Path) -> list[Path]:
    """Write a PNG for each subject that was measured; the files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    with plt.rc_context(_STYLE):
        for name, paint in _PLOTS.items():
            if name in findings.curves:
                figure = paint(findings.curves[name])
                files.append(_saved(figure, file_for(name, folder, "png")))
        judged = [row for row in findings.rows if row.of_peer or row.target]
        if judged:
            files.append(_saved(_overview(judged), folder / "overview.png"))
    return files


def _saved(figure: Any, file: Path) -> Path:
    figure.savefig(file, bbox_inches="tight")
    plt.close(figure)
    return file


def _overview(rows: Sequence[Row]) -> Any:
    """Each row's value by its target: green bars end on the good side of 1."""
    figure, axes = plt.subplots(figsize=(11, 0.26 * len(rows) + 1.2))
    excess = [_excess(row) for row in rows]
    places = np.arange(len(rows))[::-1]
    axes.barh(places, np.log10(excess), color=[_MET if row.meets else _MISSED for row in rows])
    axes.set_yticks(places, [row.row for row in rows], fontsize=7)
    for place, row, x in zip(places, rows, excess, strict=True):
        side = 0.02 if x >= 1 else -0.02
        axes.text(
            np.log10(x) + side, place, f"{number(row.value)} {row.unit}", fontsize=6.5, va="center",
            ha="left" if x >= 1 else "right",
        )  # fmt: skip
    axes.axvline(0, **{**_TARGET, "linestyle": "-"})
    axes.set_xticks(np.log10(_TIMES), [f"{times:g}" for times in _TIMES])
    axes.set_ylim(-1, len(rows))
    axes.margins(x=0.12)
    axes.set_xlabel("times the target (left of 1: met)")
    axes.set_title("dsr bench: targets met and missed")
    return figure


def _excess(row: Row) -> float:
    """How many times the target it costs; what a rate falls short by counts as cost."""
    if row.of_peer and row.ratio:
        ratio = row.ratio / row.of_peer
    else:
        assert row.target
        ratio = row.value / row.target
    return max(1 / ratio if row.unit == "per s" else ratio, 1e-3)


def _latency(data: Mapping[str, Mapping[str, Sequence[float]]]) -> Any:
    figure, panels = plt.subplots(1, 2, figsize=(12, 4.5), sharey=True)
    for axes, (title, samples) in zip(
        panels, {"reader idle": data["quiet"], "reader's main thread busy in Python": data["busy"]}.items(), strict=True
    ):
        _cumulative(axes, samples, ours=("attribute", "RT", "attribute, by a watch"))
        for target, share in zip(_LATENCY_TARGETS, (0.5, 0.99), strict=True):
            if target is not None and (share == 0.99 or title == "reader idle"):
                axes.plot([target], [share], "kv", markersize=7, clip_on=False)
                label = f"target p{share * 100:.0f}"
                axes.annotate(label, (target, share), (4, -12), textcoords="offset points", fontsize=8)
        axes.set_title(title)
    panels[0].legend(fontsize=8, loc="lower right")
    figure.suptitle("One update at 100 Hz, written to readable in another process (left is better)", y=1.02)
    return figure


def _frames(samples: Mapping[str, Sequence[float]]) -> Any:
    figure, axes = plt.subplots(figsize=(7, 4.2))
    _cumulative(axes, samples, ours=("ours",))
    axes.legend(fontsize=8, loc="lower right")
    axes.set_title("RGB-D 640x480 at 30 Hz to five readers (left is better)")
    return figure


def _cumulative(axes: Any, samples: Mapping[str, Sequence[float]], ours: Sequence[str]) -> None:
    """The share of messages that took at most so long."""
    others = iter(_OTHERS)
    for name, values in samples.items():
        style: dict[str, Any]
        if name in ours:
            style = {"color": _OURS, "linewidth": 2.0, "linestyle": ("-", "--", ":")[ours.index(name)]}
        else:
            style = {"color": next(others), "linewidth": 1.3}
        axes.plot(np.sort(values), np.linspace(0, 1, len(values)), label=_named(name, ours), **style)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda x, _: f"{x:g}" if f"{x:g}".strip("0.") in ("2", "5") else ""))
    axes.set_xlabel("ms")
    axes.set_ylabel("share of updates")


def _throughput(readers: int, target: float | None) -> Callable[[Mapping[str, float]], Any]:
    def paint(rates: Mapping[str, float]) -> Any:
        figure, axes = plt.subplots(figsize=(7, 3.6))
        ours = ("attributes", "RT")
        colors = [_OURS if name in ours else _OTHERS[0] for name in rates]
        labels = [_named(name, ours) for name in rates]
        bars = axes.bar(labels, [rate / 1e3 for rate in rates.values()], color=colors)
        axes.bar_label(bars, fmt="%.0f")
        if target is not None:
            axes.axhline(target / 1e3, **_TARGET)
            beside = axes.get_yaxis_transform()
            axes.text(0.995, target / 1e3, "target", ha="right", va="bottom", fontsize=8, transform=beside)
        axes.set_ylabel("thousand updates per s")
        axes.set_title(f"Saturated updates delivered to {'one reader' if readers == 1 else 'each of three readers'}")
        return figure

    return paint


def _join(times: Mapping[str, Mapping[str, Sequence[float]]]) -> Any:
    figure, axes = plt.subplots(figsize=(7, 4.2))
    sizes = [int(size) for size in times]
    for name, color in zip(next(iter(times.values())), (_OURS, *_OTHERS), strict=False):
        medians = [np.median(times[str(size)][name]) * 1e3 for size in sizes]
        axes.plot(sizes, medians, "o-", color=color, linewidth=2 if name == "ours" else 1.3, label=_named(name))
    _mark_targets(axes, {size: spec.target for size, spec in join.SPECS.items()})
    axes.set(xscale="log", yscale="log", xlabel="nodes, with 5 attributes each", ylabel="ms until complete")
    axes.set_xticks(sizes, [f"{size}" for size in sizes])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.legend(fontsize=8)
    axes.set_title("Late join: from connect to complete")
    return figure


def _cascade(data: Mapping[str, Any]) -> Any:
    figure, axes = plt.subplots(figsize=(7, 4.2))
    for (name, values), color in zip(data["ms"].items(), (_OURS, *_OTHERS), strict=False):
        axes.plot(data["graphs"], values, "o-", color=color, linewidth=2 if name == "ours" else 1.3, label=_named(name))
    _mark_targets(axes, {graphs: spec.target for graphs, spec in cascade.SPECS.items()})
    axes.set(xlabel="graphs passed through, a process each", ylabel="ms, median", xticks=data["graphs"])
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.set_title("One change through cascaded graphs")
    return figure


def _worlds(data: Mapping[str, Any]) -> Any:
    """Fig. 2 of the Underworlds paper, with its figures; logarithmic, for they lie far apart."""
    figure, axes = plt.subplots(figsize=(7, 4.2))
    for (name, values), color in zip(data["ms"].items(), (_OURS, *_OTHERS), strict=False):
        style = "s--" if "published" in name else "o-"
        axes.plot(
            data["worlds"], values, style, color=color, linewidth=2 if name == "ours" else 1.3, label=_named(name)
        )
    _mark_targets(axes, {worlds: spec.target for worlds, spec in world_cascade.SPECS.items()})
    axes.set(xlabel="worlds, a filter process between each two", ylabel="ms, median", yscale="log")
    axes.set_xticks(data["worlds"], [str(worlds) for worlds in data["worlds"]])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.legend(fontsize=8)
    axes.set_title("One node created, through cascaded worlds")
    return figure


def _growth(data: Mapping[str, Any]) -> Any:
    figure, axes = plt.subplots(figsize=(8, 4.8))
    colors = plt.get_cmap("tab10").colors
    for (name, values), color in zip(data["us"].items(), colors, strict=False):
        axes.plot(data["nodes"], values, "o-", color=color, linewidth=1.5, label=name)
    axes.set(xscale="log", yscale="log", xlabel="nodes in the graph", ylabel="us per operation")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_title("Growth: level lines cost the same in graphs of every size")
    return figure


def _named(name: str, ours: Sequence[str] = ()) -> str:
    if name == "ours":
        return "dsr"
    return f"dsr, {name}" if name in ours else name


def _mark_targets(axes: Any, targets: Mapping[int, float | None]) -> None:
    axes.plot(list(targets), list(targets.values()), "kv", markersize=7, label="target: below", clip_on=False)


_PLOTS: dict[str, Callable[[Any], Any]] = {
    "latency": _latency,
    "throughput to 1": _throughput(1, throughput.ATTRIBUTES.target),
    "throughput to 3": _throughput(3, throughput.ATTRIBUTES_3.target),
    "join": _join,
    "camera frames": _frames,
    "cascade": _cascade,
    "world cascade": _worlds,
    "growth": _growth,
}
