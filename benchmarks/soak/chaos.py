"""A soak: faults in a random order while everybody writes; after each one, all must agree and nothing be missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.soak.faults import FAULTS, NEED_TWO_MACHINES, Scene
from benchmarks.soak.fleet import Fleet, Plan
from benchmarks.soak.journal import Record, take_records
from benchmarks.soak.judge import Judge
from benchmarks.soak.process import WorkerError
from dsr.clock import Clock
from dsr.replication.statistics import Statistics

HEAL_TIMEOUT = 60.0
"""s after which replicas that still differ count as diverged."""
_CALM = 0.5
"""s of writing before each fault."""


@dataclass
class FaultTally:
    """What one kind of fault did."""

    rounds: int = 0
    heal_s: list[float] = field(default_factory=list)
    """From the end of each fault until all replicas were equal, s."""

    def summary(self) -> dict[str, Any]:
        """For the result."""
        return {
            "rounds": self.rounds,
            "heal_s_median": float(np.median(self.heal_s)) if self.heal_s else None,
            "heal_s_max": max(self.heal_s, default=None),
        }


@dataclass
class Tally:
    """What a soak found."""

    lost: list[str] = field(default_factory=list)
    diverged: int = 0
    blocked: float = 0.0
    """The longest call of a write, s."""
    faults: dict[str, FaultTally] = field(default_factory=dict)
    statistics: dict[str, dict[str, int]] = field(default_factory=dict)
    """The newest `Memory.statistics` by worker; those of the dead are kept."""

    def result(self, judge: Judge) -> dict[str, Any]:
        """As `dsr soak --json` prints it."""
        heals = [seconds for tally in self.faults.values() for seconds in tally.heal_s]
        return {
            "writes": judge.writes,
            "lost": len(self.lost),
            "diverged": self.diverged,
            "heal_s_max": max(heals, default=0.0),
            "blocked_s_max": self.blocked,
            "kill_window_s_max": judge.kill_window,
            "faults": {name: tally.summary() for name, tally in self.faults.items()},
            "statistics": {
                name: sum(counts[name] for counts in self.statistics.values()) for name in Statistics._fields
            } if self.statistics else {},
            "findings": self.lost,
        }


class Soak:
    """One run.

    Args:
        folder: for journals and the workers' logs.
        clock: the wall clock.
        plan: who takes part.
        rate: steps/s of each worker, about three writes each.
        faults: names of those to choose from.
        fault_seconds: bounds of how long a fault goes on, s.
    """

    def __init__(
        self, folder: Path, clock: Clock, plan: Plan, *, rate: float = 50.0, faults: Sequence[str] = tuple(FAULTS),
        fault_seconds: tuple[float, float] = (1.0, 10.0),
    ) -> None:  # fmt: skip
        self.tally = Tally()
        skew = max(plan.shifts) - min(plan.shifts)
        self.judge = Judge(skew)
        self._clock = clock
        self._names = [name for name in faults if plan.machines > 1 or name not in NEED_TWO_MACHINES]
        self._fault_seconds = fault_seconds
        self._generator = np.random.default_rng(plan.seed)
        self._folder, self._plan, self._rate = folder, plan, rate

    def run(self, seconds: float, progress: Callable[[str, Tally], None], rounds: int = 1) -> None:
        """Inject faults for `seconds` s, and for so many `rounds` at least; `progress` is told about each one.

        A worker that ends or hangs counts as a loss, and ends the run.
        """
        with Fleet(self._folder, self._clock, self._plan) as fleet:
            scene = Scene(fleet, self.judge, self._generator, self._rate)
            begin = self._clock.monotonic()
            for number, name in enumerate(self._endless_faults()):
                if number >= rounds and self._clock.monotonic() - begin > seconds:
                    return
                progress(name, self.tally)
                try:
                    self._round(scene, name)
                except WorkerError as error:
                    self.tally.lost.append(f"during {name}: {error}")
                    return

    def _endless_faults(self) -> Iterator[str]:
        """All faults in a random order, again and again."""
        while True:
            for index in self._generator.permutation(len(self._names)):
                yield self._names[index]

    def _round(self, scene: Scene, name: str) -> None:
        fleet = scene.fleet
        fleet.run(self._rate)
        scene.wait(_CALM)
        FAULTS[name](scene, float(self._generator.uniform(*self._fault_seconds)))
        healed_at = self._clock.monotonic()
        fleet.pause()
        heal = fleet.seconds_until_equal(healed_at, HEAL_TIMEOUT)
        tally = self.tally.faults.setdefault(name, FaultTally())
        tally.rounds += 1
        if heal is None:
            self.tally.diverged += 1
        else:
            tally.heal_s.append(heal)
        self._judge(scene)

    def _judge(self, scene: Scene) -> None:
        """Everybody is idle: read the journals, look for what is missing, and clear away what the dead left."""
        workers = scene.fleet.everybody()
        for worker in workers:
            records = list(take_records(worker.journal))
            self.judge.note(worker.slot, records)
            self.tally.blocked = max([self.tally.blocked, *_blocked(records, worker.slot, scene.frozen)])
        self.tally.lost += self.judge.check(workers[0].do("state"))
        scene.frozen.clear()
        for worker in workers:
            report = worker.do("report")
            if report["failure"]:
                self.tally.lost.append(f"{worker.slot} could not write: {report['failure']}")
            self.tally.statistics[worker.journal.stem] = report["statistics"]
            worker.do("tidy")


def _blocked(records: Sequence[Record], slot: str, frozen: Sequence[tuple[str, float, float]]) -> list[float]:
    """How long each call took, s, except those of a worker that was stopped meanwhile."""
    own = [(begin, end) for who, begin, end in frozen if who == slot]
    return [
        record.ended - record.started
        for record in records
        if not any(record.started < end and begin < record.ended for begin, end in own)
    ]
