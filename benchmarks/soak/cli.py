"""`dsr soak`: real processes write while links are cut and processes die; counts what is lost and what differs."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.soak.chaos import Soak, Tally
from benchmarks.soak.faults import FAULTS, NEED_TWO_MACHINES
from benchmarks.soak.fleet import Plan
from benchmarks.soak.races import RACES, run_races
from dsr.cli.common import JsonFileOption, JsonOption, add_names, add_numbers, check_writable, for_people, put_json
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError, suggest

app = typer.Typer(name="soak", invoke_without_command=True, subcommand_metavar="")

_SHIFTS = (0.0, 0.15, -0.15)
"""s by which the workers' clocks are wrong, in turn; less than what counts as drift."""


@app.callback()
def soak(
    seconds: Annotated[float, typer.Option(min=1.0, help="How long to go on; the last fault is finished.")] = 60.0,
    processes: Annotated[int, typer.Option(min=2, max=16, help="How many write.")] = 4,
    machines: Annotated[
        int, typer.Option(min=1, max=2, help="2: two groups that reach each other only through a hub and a wire.")
    ] = 2,
    rate: Annotated[float, typer.Option(min=1.0, help="Steps/s of each process, about three writes each.")] = 50.0,
    fault: Annotated[
        list[str] | None, typer.Option(help=f"Only this one; may be repeated. {', '.join(FAULTS)}.")
    ] = None,
    shortest: Annotated[float, typer.Option(min=0.0, help="s that a fault goes on at least.")] = 1.0,
    longest: Annotated[float, typer.Option(min=1.0, help="s that a fault may go on.")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the order and length of faults.")] = 0,
    races: Annotated[
        int, typer.Option(min=0, help="Instead: so many rounds of each race of two processes.")
    ] = 0,
    as_json: JsonOption = False,
    json_file: JsonFileOption = None,
) -> None:
    """Try to break the working memory: processes write all the time while things go wrong.

    Processes are killed (the oldest too) while others join, or stopped; the network is cut, or silently passes
    nothing; the hub dies; one writes as fast as it can beside one that is slow. Clocks differ by up to 0.3 s. After
    each fault, writing pauses until all replicas are equal, and every write that returned must be there, unless a
    later one replaced it. The exit code is 0 only if nothing was lost and nothing differed. It works on a graph of
    its own and disturbs no other.

    Example: dsr soak --seconds 300 --json-file soak.json; only races: dsr soak --races 200
    """
    said = for_people(as_json)
    check_writable(json_file)
    with tempfile.TemporaryDirectory(prefix="dsr-soak-") as folder:
        if races:
            result, holds = _races(Path(folder), races, seed, said)
        else:
            plan = Plan(processes, machines, seed, _SHIFTS)
            names = _checked_faults(fault, machines)
            lengths = (min(shortest, longest), longest)
            run = Soak(Path(folder), WALL_CLOCK, plan, rate=rate, faults=names, fault_seconds=lengths)
            result, holds = _soak(run, seconds, said)
    put_json(result, as_json=as_json, file=json_file)
    raise typer.Exit(0 if holds else 1)


def _checked_faults(names: Sequence[str] | None, machines: int) -> Sequence[str]:
    """The faults asked for, all by default. Raises `ConfigError`."""
    for name in names or ():
        if name not in FAULTS:
            raise ConfigError(f"unknown fault {name!r}; {suggest(name, FAULTS)}")
        if machines < 2 and name in NEED_TWO_MACHINES:
            raise ConfigError(f"fault {name!r} needs --machines 2")
    return names or tuple(FAULTS)


def _soak(run: Soak, seconds: float, console: Console) -> tuple[dict[str, Any], bool]:
    """Run it, or as much of it as Ctrl-C leaves."""
    interrupted = False
    with console.status("starting", spinner="line") as status:

        def show(fault: str, tally: Tally) -> None:
            found = f"{len(tally.lost)} lost, {tally.diverged} diverged"
            status.update(f"{run.judge.writes} writes, {found}; now {fault}")

        try:
            run.run(seconds, show)
        except KeyboardInterrupt:
            interrupted = True
    result = run.tally.result(run.judge)
    console.print(_fault_table(result))
    for finding in run.tally.lost[:20]:
        console.print(f"[red]lost:[/] {finding}", soft_wrap=True)
    console.print(
        f"{result['writes']} writes, {result['lost']} lost, {result['diverged']} diverged, "
        f"healed within {result['heal_s_max']:.2f} s, no write took longer than {result['blocked_s_max']:.2f} s",
        soft_wrap=True,
    )
    if interrupted:
        console.print("interrupted: what was judged until then")
    return result, not result["lost"] and not result["diverged"] and result["writes"] > 0


def _fault_table(result: dict[str, Any]) -> Table:
    table = Table()
    add_names(table, "fault")
    add_numbers(table, "rounds", "healed in s (median)", "at most")
    for name, row in result["faults"].items():
        times = [row["heal_s_median"], row["heal_s_max"]]
        table.add_row(name, str(row["rounds"]), *("-" if time is None else f"{time:.2f}" for time in times))
    return table


def _races(folder: Path, rounds: int, seed: int, console: Console) -> tuple[dict[str, Any], bool]:
    with console.status("racing", spinner="line") as status:
        result = run_races(folder, WALL_CLOCK, rounds, seed, lambda race: status.update(f"{race} done"))
    table = Table()
    add_names(table, "race", "meaning")
    add_numbers(table, "rounds", "equal", "right", "apart, ms\n(median)")
    for name in RACES:
        row = result[name]
        numbers = [str(row[key]) for key in ("rounds", "equal", "right")]
        table.add_row(name, row["meaning"], *numbers, f"{row['apart_ms_median']:.3f}")
    console.print(table)
    return result, all(row["equal"] == row["right"] == row["rounds"] for row in result.values())
