"""What would a compiled core of the memory gain? Measures a prototype in C++ in the place of its Python.

    python -m benchmarks.compiled                     # all, in six minutes; install the peers for the rows: make bench
    python -m benchmarks.compiled --seconds 0 --rounds 3    # without the live system

The prototype (benchmarks/compiled/core.cpp) is compiled into a temporary folder and first compared with the Python code
on random changes and messages. Without a compiler nothing is measured. Then come:

- the live system by poses, with the processor time of the memory's Python in all of its processes;
- the steps of the rows of `dsr bench`, in processor time: Python, the core called by methods as those of the memory
  (lock, clock, checks), and the core alone;
- single updates between two processes: raw Zenoh, the core at both ends of it with nothing else, and the memory;
- what all this means for the rows, and for the whole system: what is left if the core did all that it can.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import session, workload
from benchmarks.compiled import steps
from benchmarks.compiled.building import build, why_not
from benchmarks.compiled.comparing import compare
from benchmarks.compiled.steps import CORE, PYTHON, SHELL, Times
from benchmarks.compiled.whole import shares
from benchmarks.links import DsrLink, Link
from benchmarks.pairs import in_turns
from benchmarks.peers import zenoh_query
from benchmarks.peers.compiled_link import CompiledLink
from benchmarks.peers.zenoh_link import ZenohLink
from benchmarks.ports import reserved_endpoint
from benchmarks.rows import number
from benchmarks.workers import Worker

_COMPARED, _STEPS = 10, 500
"""Random histories, and their steps, in which the prototype must equal Python before it is measured."""
KINDS = ("attribute", "RT")
OneWay = dict[str, dict[str, float]]
"""By kind of update and by link: s, median, and over raw Zenoh of the same round."""


def one_way(file: Path, rounds: int) -> OneWay:
    """Updates between two processes, p50 over that of raw Zenoh in the same round: medians of rounds."""
    found: OneWay = {}
    for kind in KINDS:
        size = workload.message_size(rt=kind == "RT")
        links: dict[str, Link] = {
            "raw Zenoh": ZenohLink(reserved_endpoint(), size, reliable=kind != "RT"),
            "core": CompiledLink(reserved_endpoint(), str(file), kind),  # type: ignore[arg-type]
            "memory": DsrLink(f"compiled-{kind}", kind),  # type: ignore[arg-type]
        }
        times = in_turns(links, rounds)
        found[kind] = {
            name: statistics.median(mine / raw for mine, raw in zip(taken, times["raw Zenoh"], strict=True))
            for name, taken in times.items()
        }
    return found


def fetched(file: Path, rounds: int) -> float:
    """Raw Zenoh: a session, and as many bytes as the content that a newcomer joins; median, s."""
    size = sum(map(len, steps.filled(file, "holder", steps.JOINED).pieces()))
    endpoint = reserved_endpoint()
    with Worker(zenoh_query.hold_bytes, endpoint, size) as holder:
        holder.receive()
        return statistics.median(zenoh_query.fetch(endpoint, size) for _ in range(rounds))


def steps_table(times: Times) -> Table:
    """What each step takes."""
    table = Table("step", "unit", PYTHON, SHELL, CORE, "gain", title="processor time of the steps")
    for step, taken in times.items():
        unit = "ms" if step.startswith(steps.LATE_JOIN) else "us"
        figures = [number(taken[who] * 1e3) if who in taken else "-" for who in (PYTHON, SHELL, CORE)]
        table.add_row(step, unit, *figures, f"{taken[PYTHON] / taken.get(SHELL, taken[CORE]):.1f} x")
    return table


def rows_table(times: Times, ways: OneWay, raw_join: float, spark: dict[str, float]) -> Table:
    """What the rows are, and would be at best."""
    table = Table("row, by its peer", "the memory", "with the core", "target", title="rows")
    for kind, of in ways.items():
        table.add_row(f"{kind} update between two processes", f"{of['memory']:.2f}", f"{of['core']:.2f}", "1.3")
        left = (of["core"] - 1) / (of["memory"] - 1)
        table.add_row(f"{kind}: what is left of the time beyond raw Zenoh's", "1", f"{left:.2f}", "-")
    for step, (peer, target) in {
        steps.INSERT: ("insert", "0.8"), steps.UPDATE: ("update", "0.8"), steps.RT: ("update", "0.8")
    }.items():  # fmt: skip
        if peer in spark:
            rates = (f"{spark[peer] / times[step][who]:.2f}" for who in (PYTHON, SHELL))
            table.add_row(f"local: {step}, rate by Spark-DSG", *rates, target)
    joins = [sum(times[step][who] for step in steps.JOIN) for who in (PYTHON, CORE)]
    table.add_row("late join, the two steps after the bytes", *(f"{1 + one / raw_join:.1f}" for one in joins), "15")
    return table


def whole_table(cores: float, took: dict[str, float], times: Times) -> Table:
    """What the whole system takes, and would take."""
    gains = {
        "written": _gain(times, steps.UPDATE, steps.RT), "sent": _gain(times, steps.SENT),
        "received": _gain(times, *steps.RECEIVED),
    }  # fmt: skip
    table = Table("the memory's Python", "share", "with the core", title=f"the live system, {cores:.2f} cores")
    left, whole = 0.0, 0.0
    for part, share in took.items():
        if part != "Zenoh":
            rest = share / gains.get(part, 1.0)
            whole, left = whole + share, left + rest
            table.add_row(part, f"{share:.1%}", f"{rest:.1%}")
    table.add_row("all of it", f"{whole:.1%}", f"{left:.1%}")
    table.add_row("the whole system", "100 %", f"{1 - whole + left:.1%}")
    table.caption = f"were the memory free of charge: {1 - whole:.1%}"
    return table


def _gain(times: Times, *names: str) -> float:
    ours, core = (
        sum(taken.get(who, taken[CORE]) for taken in (times[name] for name in names)) for who in (PYTHON, SHELL)
    )
    return ours / core


def _tables(rounds: int, file: Path, live: tuple[float, dict[str, float]] | None) -> Iterator[Table]:
    with session.private_runtime():
        times, spark = steps.measure(file, rounds), steps.spark(rounds)
        yield steps_table(times)
        yield rows_table(times, one_way(file, rounds), fetched(file, rounds), spark)
    if live is not None:
        yield whole_table(*live, times)


def main() -> None:
    """Build, compare, measure and show."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.compiled", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=9, help="in which all take turns (default: 9)")
    parser.add_argument("--seconds", type=float, default=30.0, help="of the live system; 0 for none (default: 30)")
    parser.add_argument("--scenario", default="towers", help="that the live system plays (default: towers)")
    options = parser.parse_args()
    console = Console()
    if (missing := why_not()) is not None:
        console.print(f"not measured: {missing}")
        return
    live = shares(options.scenario, options.seconds, 0) if options.seconds else None  # first of all: it forks
    with tempfile.TemporaryDirectory(prefix="dsr-compiled-") as folder:
        file = build(Path(folder))
        for seed in range(_COMPARED):
            compare(file, seed, _STEPS)
        console.print(f"the prototype equals Python in {_COMPARED} random histories of {_STEPS} steps")
        for table in _tables(options.rounds, file, live):
            console.print(table)


if __name__ == "__main__":
    main()
