"""What a robot gets as its fleet grows, each robot in rooms of its own: counted, and on paper for larger fleets.

All processes run in this one, on a network in memory. Of what a robot gets, two things follow the fleet: a digest
of the base per second of each other process, and for each room that somebody begins to hold a question to all, with its
answers. So a larger fleet on paper has those in proportion, and the rest as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.interest.curves import fleet_of

ON_PAPER = (1000, 10_000)
"""Robots"""


def counted(numbers: Iterable[int], tell: Callable[[str], None]) -> list[dict[str, Any]]:
    """Count what one of so many robots gets per second, for each number; then larger fleets on paper."""
    rows = []
    for number in numbers:
        rows.append(fleet_of(number, parted=True))
        tell(shown(rows[-1]))
    papers = [on_paper(rows, number) for number in ON_PAPER]
    for row in papers:
        tell(f"on paper {shown(row)}")
    return rows + papers


def on_paper(rows: Sequence[dict[str, Any]], robots: int) -> dict[str, Any]:
    """What one of so many robots would get, as the largest counted fleet tells; see the top of the file."""
    largest = max(rows, key=lambda row: row["robots"])
    factor = robots / largest["robots"]
    digests, questions = np.multiply(largest["digests"], factor), np.multiply(largest["questions"], factor)
    messages, size = digests + questions + rest_of(largest)
    return {
        "robots": robots, "parted": True, "on_paper": True, "messages": float(messages), "bytes": float(size),
        "digests": digests.tolist(), "questions": questions.tolist(),
    }  # fmt: skip


def rest_of(row: dict[str, Any]) -> NDArray[np.float64]:
    """Messages and bytes that do not follow the fleet."""
    rest: NDArray[np.float64] = np.array([row["messages"], row["bytes"]]) - row["digests"] - np.array(row["questions"])
    return rest


def shown(row: dict[str, Any]) -> str:
    """One row in words."""
    kinds = (("digests of the base", row["digests"]), ("who holds what", row["questions"]), ("all else", rest_of(row)))
    told = ", ".join(f"{kind} {messages:.1f} ({size / 1e3:.2f} kB)" for kind, (messages, size) in kinds)
    return f"{row['robots']} robots, messages that one gets per second: {told}"
