"""Runs histories: of a seed, or of given steps; what it came to, and why it failed if it did."""

from __future__ import annotations

import contextlib
import logging
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from benchmarks.years.beginning import begun
from benchmarks.years.differences import Differences
from benchmarks.years.shrinking import shrunk
from benchmarks.years.steps import Step, day
from benchmarks.years.world import Complaints

PARTS = ("dsr.replication", "dsr.worlds", "dsr.graph", "dsr.crdt")
"""Loggers of which no error is expected, whatever happens; of the disk's errors the keeper tells, and rightly."""


@dataclass(frozen=True)
class Setting:
    """What a history needs beside its steps."""

    seed: int
    places: int = 5
    days: int = 5
    steps: int = 300
    """Steps of each day."""

    @property
    def secured(self) -> bool:
        """Whether the graph is secured: every other one is."""
        return self.seed % 2 == 1

    def history(self) -> list[Step]:
        """The steps of all days."""
        return [step for number in range(self.days) for step in day(self.seed, number, self.steps)]


@dataclass
class Outcome:
    """What a history came to."""

    lived: float = 0.0
    slept: float = 0.0
    met: Counter[str] = field(default_factory=Counter)
    """Faults by kind."""
    kills: Counter[str] = field(default_factory=Counter)
    """At which kinds of calls processes were killed."""
    problem: str = ""
    """What was wrong, and where; empty if nothing was."""
    differences: int = 0
    """How often two had seen the same and held something else, for want of the dot of a removal."""


def run(setting: Setting, steps: Sequence[Step] | None = None) -> Outcome:
    """Run the history of a setting, or these steps in its place."""
    with quiet() as complaints, begun(setting.places, setting.seed, secured=setting.secured) as history:
        differences, problem = Differences(history), ""
        try:
            with differences.watched():
                for step in setting.history() if steps is None else steps:
                    history.take(step)
                    if complaints.said or differences.unexplained:
                        problem = f"an error was logged: {[*complaints.said, *differences.unexplained][0]}"
                        break
        except Exception as error:  # whatever comes out is a finding
            place = traceback.extract_tb(error.__traceback__)[-1]
            problem = f"{type(error).__name__}: {error} ({place.name})"
        return Outcome(history.lived, history.slept, history.met, history.kills, problem, differences.explained)


def shortest(setting: Setting, steps: Sequence[Step], problem: str) -> list[Step]:
    """Fewer of these steps that fail with the same problem."""
    return shrunk(steps, lambda fewer: run(setting, fewer).problem == problem)


@contextlib.contextmanager
def quiet() -> Iterator[Complaints]:
    """Nothing is logged but what the returned collector takes down: errors of `PARTS`."""
    logger = logging.getLogger("dsr")
    complaints, nothing, propagated = Complaints(), logging.NullHandler(), logger.propagate
    logger.addHandler(nothing)
    logger.propagate = False
    for part in PARTS:
        logging.getLogger(part).addHandler(complaints)
    try:
        yield complaints
    finally:
        for part in PARTS:
            logging.getLogger(part).removeHandler(complaints)
        logger.removeHandler(nothing)
        logger.propagate = propagated
