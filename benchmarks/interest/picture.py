"""Draws the curves of what interest costs and spares."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

from benchmarks.interest.curves import Findings, Join
from benchmarks.interest.fleets import rest_of
from dsr.replication.peers import MAX_PEERS

mpl.use("Agg")
import matplotlib.pyplot as plt


def draw(findings: Findings, file: Path) -> None:
    """Draw all curves into one picture."""
    figure, axes = plt.subplots(2, 3, figsize=(12.0, 7.0))
    _join(axes[0, 0], findings.by_building, "nodes", "nodes of the building; three rooms are asked for")
    _join(axes[0, 1], findings.by_interest, "asked", f"rooms asked for, of {findings.by_interest[0].rooms}")
    _memory(axes[0, 2], findings)
    _writers(axes[1, 0], findings)
    _fleets(axes[1, 1], findings)
    _idle(axes[1, 2], findings)
    figure.tight_layout()
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_machines(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw what machines behind a router cost."""
    figure, axes = plt.subplots(1, 3, figsize=(12.0, 3.8))
    panels = (
        ("bytes", 1e3, "link of a machine", "kB per second, both ways"),
        ("received", 1.0, "messages with changes", "per second, of one robot"),
        ("join", 1e3, "one more machine joins", "kB on its link"),
    )
    for place, (field, unit, title, label) in zip(axes, panels, strict=True):
        for parted, told in ((False, "all hold all"), (True, "each robot holds three rooms")):
            of_it = [row for row in rows if row["parted"] == parted]
            place.plot([row["machines"] for row in of_it], [row[field] / unit for row in of_it], "o-", label=told)
        place.set(title=title, xlabel="machines", ylabel=label, ylim=(0, None))
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_fleets(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw what a robot gets against the size of its fleet: counted up to a line, and on paper beyond."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.8))
    last = max(row["robots"] for row in rows if not row.get("on_paper"))
    robots = [row["robots"] for row in rows]
    for place, number, unit, label in ((axes[0], 0, 1.0, "messages"), (axes[1], 1, 1e3, "kB")):
        place.loglog(robots, [row["digests"][number] / unit for row in rows], "o-", label="digests of the base")
        place.loglog(robots, [row["questions"][number] / unit for row in rows], "o-", label="who holds what")
        place.loglog(robots, [rest_of(row)[number] / unit for row in rows], "o-", label="all else: its rooms")
        place.axvspan(last, max(robots), color="0.9", label="on paper")
        place.axvline(MAX_PEERS, color="0.3", linestyle=":", label="replicas that are listened to")
        place.set(xlabel="robots", ylabel=f"{label} that one gets per second")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _join(axes: Any, joins: list[Join], field: str, label: str) -> None:
    axes.loglog([getattr(join, field) for join in joins], [join.received / 1e3 for join in joins], "o-")
    axes.set_ylim(bottom=10)
    axes.set(title="late join", xlabel=label, ylabel="kB received")


def _memory(axes: Any, findings: Findings) -> None:
    for joins, label in ((findings.by_building, "larger building"), (findings.by_interest, "more rooms asked for")):
        axes.loglog([join.nodes if joins is findings.by_building else join.asked * 1000 for join in joins],
                    [join.memory / 1e6 for join in joins], "o-", label=label)  # fmt: skip
    axes.set(title="memory of a process", xlabel="nodes of the building, or of what is asked for", ylabel="MB")
    axes.legend()


def _writers(axes: Any, findings: Findings) -> None:
    for elsewhere, label in ((True, "readers in another room"), (False, "readers in the same room")):
        rows = [row for row in findings.writers if row["elsewhere"] == elsewhere]
        axes.plot([row["readers"] for row in rows], [row["bytes"] / 1e3 for row in rows], "o-", label=label)
    axes.set(title="100 writes", xlabel="readers", ylabel="kB sent by the writer")
    axes.legend()


def _fleets(axes: Any, findings: Findings) -> None:
    for parted, label in ((False, "all hold all"), (True, "each holds three rooms")):
        rows = [row for row in findings.fleets if row["parted"] == parted]
        axes.loglog([row["robots"] for row in rows], [row["messages"] for row in rows], "o-", label=label)
    axes.set(title="robots at work", xlabel="robots", ylabel="messages that one gets per second")
    axes.legend()


def _idle(axes: Any, findings: Findings) -> None:
    rows = findings.idle
    axes.loglog([row["parts"] for row in rows], [row["bytes"] for row in rows], "o-")
    axes.set(title="nothing happens", xlabel="parts held", ylabel="bytes per second to each other holder")
