"""The command `dsr scenario sweep`."""

from __future__ import annotations

import csv
import enum
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from agents.scenario.check.file_check import show_all
from agents.scenario.format.scenario import find_scenario, load_scenario
from agents.scenario.options import Hands, SensorChoice, UntaggedOption, complete_scenario
from agents.scenario.run.staging import HandFinder, Policy, Sensor, make_run, staged_system
from agents.scenario.run.statistics import RunSummary, Spread, summarise
from agents.scenario.run.sweep import LIMIT, RunOutcome, Sweep
from agents.scenario.run.sweep_report import SweepBar, show_sweep
from agents.scenario.run.sweep_worker import SweepJob
from dsr.cli.common import JsonFileOption, JsonOption, check_writable, for_people, put_json, shown
from dsr.cli.interrupts import INTERRUPTED
from dsr.errors import ConfigError

MOST_SEEDS = 100_000
_PART = re.compile(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?")


class SweptPolicy(enum.StrEnum):
    """Values of `--policy`."""

    HYPOTHESES = "hypotheses"
    ALGORITHM1 = "algorithm1"
    PUBLISHED = "published"
    BOTH = "both"
    """Both policies that explain surprises."""


class SweepProgress(msgspec.Struct, frozen=True):
    """What `--json` prints, and `--json-file` writes."""

    complete: bool
    """Every run was made."""
    summaries: list[RunSummary]
    runs: list[RunOutcome]


def sweep(
    scenarios: Annotated[
        list[str], typer.Argument(help="Built-in scenarios or TOML files.", autocompletion=complete_scenario)
    ],
    seeds: Annotated[str, typer.Option(help="Which seeds: 0-49, 7, or 0-9,20-29.")] = "0-49",
    sensor: Annotated[
        SensorChoice, typer.Option(help="True poses with the noise measured on images (fast), or rendered images.")
    ] = SensorChoice.POSES,
    policy: Annotated[
        list[SweptPolicy] | None,
        typer.Option(help="Methods side by side; `both`: the two that explain. Default: the system's."),
    ] = None,
    hands: Hands = None,
    untagged: UntaggedOption = False,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per core.")] = None,
    limit: Annotated[float, typer.Option(min=1.0, help="s of real time that one run may take.")] = LIMIT,
    metrics: Annotated[bool, typer.Option("--metrics", help="Show every metric, also of several scenarios.")] = False,
    curves: Annotated[
        Path | None, typer.Option(help="Write how far off unseen objects were, second by second, to this CSV file.")
    ] = None,
    as_json: JsonOption = False,
    json_file: JsonFileOption = None,
) -> None:
    """Run scenarios with many seeds, in lockstep on all cores, and show how often and how well they work.

    A run that crashes or takes too long counts as failed and is listed with its reason.

    The exit code is 0 only if every run passed. Ctrl-C stops all and shows what was done, as JSON too.
    """
    finder = hands and hands.value
    plan = make_jobs(
        scenarios, parse_seeds(seeds), sensor.value, _policies(policy or []), hands=finder, untagged=untagged
    )
    said = for_people(as_json)
    check_writable(json_file)
    check_writable(curves, "--curves")
    for scenario in dict.fromkeys(scenarios):
        staged_system(make_run(scenario, sensor=sensor.value, hands=finder, untagged=untagged))
        show_all(scenario, said)
    outcomes: list[RunOutcome] = []
    try:
        with Sweep(plan, jobs or os.cpu_count() or 1, limit) as running, SweepBar(len(plan), said) as bar:
            for outcome in running.outcomes():
                outcomes.append(outcome)
                bar.show(outcomes)
    except KeyboardInterrupt:
        said.print(f"stopped after {len(outcomes)} of {len(plan)} runs")
    complete = len(outcomes) == len(plan)
    summaries = summarise(outcomes)
    show_sweep(summaries, said, metrics=metrics or len(set(scenarios)) == 1)
    if curves:
        write_curves(summaries, curves)
        said.print(f"curves     {shown(str(curves))}", soft_wrap=True)
    put_json(SweepProgress(complete, summaries, outcomes), as_json=as_json, file=json_file)
    if not complete:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if all(outcome.passed for outcome in outcomes) else 1)


def parse_seeds(text: str) -> list[int]:
    """The seeds of `0-49`, `7` or `0-9,20-29`, each once. Raises `ConfigError`."""
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = _PART.fullmatch(part)
        if match is None:
            raise ConfigError(f"--seeds {text!r}: expected numbers and ranges, like 0-49 or 3,7,20-29; got {part!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise ConfigError(f"--seeds {text!r}: {part.strip()!r} ends before it begins")
        if last - first >= MOST_SEEDS:
            raise ConfigError(f"--seeds {text!r}: expected at most {MOST_SEEDS} seeds")
        seeds |= dict.fromkeys(range(first, last + 1))
    return list(seeds)


def make_jobs(
    scenarios: list[str],
    seeds: list[int],
    sensor: str,
    policies: list[Policy | None],
    *,
    hands: str | None = None,
    untagged: bool = False,
) -> list[SweepJob]:
    """Make the jobs of all runs, scenario by scenario. Raises `ConfigError` for a scenario that is wrong."""
    files = {load_scenario(name, without_tags=untagged).name: find_scenario(name).resolve() for name in scenarios}
    if len(files) < len({find_scenario(name).resolve() for name in scenarios}):
        raise ConfigError("two of the scenarios have the same name; expected different ones")
    return [
        SweepJob(
            name=name,
            file=str(file),
            seed=seed,
            sensor=msgspec.convert(sensor, Sensor),
            policy=policy,
            hands=msgspec.convert(hands, HandFinder | None),
            untagged=untagged,
        )
        for name, file in files.items()
        for seed in seeds
        for policy in policies
    ]


def write_curves(summaries: Sequence[RunSummary], file: Path) -> None:
    """Write what was measured over time as CSV: a line for each time at which some run has it."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["scenario", "policy", "curve", "time_s", *Spread.__struct_fields__])
        for summary in summaries:
            for name, curve in summary.curves.items():
                for time, spread in curve:
                    about = [summary.scenario, summary.policy or "", name, f"{time:g}"]
                    writer.writerow([*about, *(f"{value:.6g}" for value in msgspec.structs.astuple(spread))])


def _policies(chosen: list[SweptPolicy]) -> list[Policy | None]:
    if not chosen:
        return [None]
    both = SweptPolicy.BOTH in chosen
    known: tuple[Policy, ...] = ("hypotheses", "algorithm1", "published")
    return [policy for policy in known if policy in chosen or (both and policy != "published")]
