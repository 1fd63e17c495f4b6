"""The command `dsr scenario sweep`."""

from __future__ import annotations

import csv
import enum
import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import msgspec
import typer
from rich.console import Console

from agents.scenario.check.file_check import show_all
from agents.scenario.format.scenario import find_scenario, load_scenario
from agents.scenario.generate_cli import write_episodes
from agents.scenario.options import Hands, SensorChoice, UntaggedOption, complete_scenario, parse_seeds
from agents.scenario.run.staging import HandFinder, Policy, Sensor, make_run, staged_system
from agents.scenario.run.statistics import RunSummary, Spread, summarise
from agents.scenario.run.sweep import LIMIT, RunOutcome, Sweep
from agents.scenario.run.sweep_report import SweepBar, show_sweep
from agents.scenario.run.sweep_worker import SweepJob
from dsr.cli.common import JsonFileOption, JsonOption, check_writable, for_people, put_json, shown
from dsr.cli.interrupts import INTERRUPTED
from dsr.errors import ConfigError


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
        list[str] | None, typer.Argument(help="Built-in scenarios or TOML files.", autocompletion=complete_scenario)
    ] = None,
    generate: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FAMILY:SEEDS", help="Random episodes, such as stacks:0-99, each run once with its own seed."
        ),
    ] = None,
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

    A run that crashes or takes too long counts as failed and is listed with its reason. Random episodes
    (--generate, see `dsr scenario generate`) are summed up by family.

    The exit code is 0 only if every run passed. Ctrl-C stops all and shows what was done, as JSON too.
    """
    said, finder, methods = for_people(as_json), hands and hands.value, _policies(policy or [])
    check_writable(json_file)
    check_writable(curves, "--curves")
    names = scenarios or []
    if not names and not generate:
        raise ConfigError("nothing to run; expected scenarios, or --generate FAMILY:SEEDS")
    plan = make_jobs(names, parse_seeds(seeds), sensor.value, methods, hands=finder, untagged=untagged)
    for scenario in dict.fromkeys(names):
        staged_system(make_run(scenario, sensor=sensor.value, hands=finder, untagged=untagged))
        show_all(scenario, said)
    with TemporaryDirectory(prefix="dsr-episodes-") as folder:
        for episode in write_episodes(generate or [], Path(folder)):
            jobs_of_it = make_jobs([str(episode.file)], [episode.seed], sensor.value, methods, hands=finder)
            plan += [msgspec.structs.replace(job, name=episode.family, untagged=untagged) for job in jobs_of_it]
        outcomes = _played(plan, jobs or os.cpu_count() or 1, limit, said)
    complete = len(outcomes) == len(plan)
    summaries = summarise(outcomes)
    show_sweep(summaries, said, metrics=metrics or len(summaries) == 1)
    if curves:
        write_curves(summaries, curves)
        said.print(f"curves     {shown(str(curves))}", soft_wrap=True)
    put_json(SweepProgress(complete, summaries, outcomes), as_json=as_json, file=json_file)
    if not complete:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(0 if all(outcome.passed for outcome in outcomes) else 1)


def _played(plan: list[SweepJob], workers: int, limit: float, said: Console) -> list[RunOutcome]:
    """The outcomes of all runs, or of those until Ctrl-C."""
    outcomes: list[RunOutcome] = []
    try:
        with Sweep(plan, workers, limit) as running, SweepBar(len(plan), said) as bar:
            for outcome in running.outcomes():
                outcomes.append(outcome)
                bar.show(outcomes)
    except KeyboardInterrupt:
        said.print(f"stopped after {len(outcomes)} of {len(plan)} runs")
    return outcomes


def make_jobs(
    scenarios: Sequence[str],
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
