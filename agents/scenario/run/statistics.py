"""Statistics of many runs of a scenario: successes, medians, 95 % quantiles, and which seeds failed why."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import msgspec
import numpy as np

from agents.scenario.run.sweep import RunOutcome


class Spread(msgspec.Struct, frozen=True):
    """A metric over the runs that have it."""

    count: int
    """Runs that have it."""
    median: float
    p95: float
    """Value that 95 % of the runs do not exceed (linear interpolation)."""
    worst: float
    """The greatest."""


class RunSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The runs of one scenario with one policy."""

    scenario: str
    policy: str | None
    runs: int
    passed: int
    metrics: dict[str, Spread]
    curves: dict[str, list[tuple[float, Spread]]]
    """Statistics over time: at each time (s), over the runs that have it then."""
    failures: dict[str, list[int]]
    """Seeds that failed, by expectation, or by the reason of a crash."""
    wall_s: float
    """s of real time a run took, on average"""

    @property
    def title(self) -> str:
        """E.g. `full_tower, algorithm1`."""
        return self.scenario if self.policy is None else f"{self.scenario}, {self.policy}"


def summarise(outcomes: Iterable[RunOutcome]) -> list[RunSummary]:
    """Make a summary for each scenario and policy, in the order in which they are first met."""
    groups: dict[tuple[str, str | None], list[RunOutcome]] = defaultdict(list)
    for outcome in outcomes:
        groups[outcome.scenario, outcome.policy].append(outcome)
    return [_summary(sorted(group, key=lambda outcome: outcome.seed)) for group in groups.values()]


def _summary(group: list[RunOutcome]) -> RunSummary:
    failures: dict[str, list[int]] = defaultdict(list)
    values: dict[str, list[float]] = defaultdict(list)
    over_time: dict[str, dict[float, list[float]]] = defaultdict(lambda: defaultdict(list))
    for outcome in group:
        for reason in dict.fromkeys([*outcome.failed, *([outcome.crash] if outcome.crash else [])]):
            failures[reason].append(outcome.seed)
        for name, value in outcome.metrics.items():
            values[name].append(value)
        for name, curve in outcome.curves.items():
            for time, value in curve:
                over_time[name][time].append(value)
    return RunSummary(
        scenario=group[0].scenario,
        policy=group[0].policy,
        runs=len(group),
        passed=sum(outcome.passed for outcome in group),
        metrics={name: _spread(numbers) for name, numbers in values.items()},
        curves={
            name: [(time, _spread(numbers)) for time, numbers in sorted(times.items())]
            for name, times in over_time.items()
        },
        failures=dict(failures),
        wall_s=sum(outcome.wall_s for outcome in group) / len(group),
    )


def _spread(numbers: list[float]) -> Spread:
    median, p95 = np.percentile(numbers, [50, 95])
    return Spread(len(numbers), float(median), float(p95), max(numbers))
