"""Parts of a graph of which each process holds some: are they right under faults, and what do they cost?

    python -m benchmarks.interest --histories 60              # seeds 0, 1, ...: all must be right
    python -m benchmarks.interest --seed 17                   # one history again, made shorter if it fails
    python -m benchmarks.interest --mutants                   # each wrong design must be seen
    python -m benchmarks.interest --curves --json interest.json --plot interest.png
    python -m benchmarks.interest --whole 1000                # rooms of 1000 nodes, all held by one process
    python -m benchmarks.interest --fleets 5,10,20,50 --json fleets.json --plot fleets.png
    python -m benchmarks.interest --machines 1,2,5,10 --json machines.json --plot machines.png

Exit 0 only if all is as it must be.
"""

from __future__ import annotations

import argparse
import logging
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import track

from benchmarks.interest.curves import measured, whole
from benchmarks.interest.fleets import counted
from benchmarks.interest.histories import Setting, run, shortest
from benchmarks.interest.mutants import MUTANTS, shown_by

SEEDS = 40
"""Histories in which each wrong design is looked for."""


def main() -> None:
    """Do what the command line asks for; exit 1 if something is not as it must be."""
    options = _parser().parse_args()
    if options.curves:
        _curves(options.json, options.plot)
        right = True
    elif options.whole:
        print(whole(options.whole))
        right = True
    elif options.fleets:
        _fleets(options)
        right = True
    elif options.machines:
        right = _machines(options)
    elif options.mutants:
        right = _mutants()
    elif options.seed is not None:
        right = _again(options.seed)
    else:
        right = _histories(options.histories)
    raise SystemExit(0 if right else 1)


def _histories(number: int) -> bool:
    met: Counter[str] = Counter()
    changes = waiting = 0
    problems: dict[int, str] = {}
    for seed in track(range(number), "histories", console=Console(stderr=True)):
        outcome = run(Setting(seed))
        met += outcome.met
        changes, waiting = changes + outcome.changes, waiting + outcome.waiting
        if outcome.problem:
            problems[seed] = outcome.problem
            print(f"seed {seed}: {outcome.problem}")
    print(f"{number} histories, {sum(met.values())} faults: {', '.join(f'{met[kind]} {kind}' for kind in sorted(met))}")
    print(f"{changes} changes of mind, {waiting} edges that waited for a part at the end; {len(problems)} failed")
    return not problems


def _again(seed: int) -> bool:
    setting = Setting(seed)
    problem = run(setting).problem
    print(problem or "nothing was wrong")
    for step in shortest(setting, problem) if problem else ():
        print(step)
    return not problem


def _mutants() -> bool:
    right = True
    for mutant in MUTANTS:
        seed = shown_by(mutant, range(SEEDS))
        print(f"{mutant.title}: {'not seen' if seed is None else f'seen in history {seed}'}", flush=True)
        right = right and seed is not None
    return right


def _curves(json: Path | None, plot: Path | None) -> None:
    logging.getLogger("dsr").setLevel(logging.ERROR)  # many begin at once, and say that they wait for each other
    findings = measured(lambda text: print(text, flush=True))
    if json is not None:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(findings))))
    if plot is not None:
        from benchmarks.interest.picture import draw  # needs matplotlib

        draw(findings, plot)


def _fleets(options: argparse.Namespace) -> None:
    logging.getLogger("dsr").setLevel(logging.ERROR)
    rows = counted([int(number) for number in options.fleets.split(",")], lambda text: print(text, flush=True))
    if options.json is not None:
        options.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))
    if options.plot is not None:
        from benchmarks.interest.picture import draw_fleets  # needs matplotlib

        draw_fleets(rows, options.plot)


def _machines(options: argparse.Namespace) -> bool:
    from benchmarks.interest.machines import measured_machines  # needs zenoh

    rows = measured_machines(
        [int(number) for number in options.machines.split(",")], lambda text: print(text, flush=True),
        robots=options.robots, routers=options.routers, parted_only=options.parts_only,
    )  # fmt: skip
    if options.json is not None:
        options.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))
    if options.plot is not None:
        from benchmarks.interest.picture import draw_machines  # needs matplotlib

        draw_machines(rows, options.plot)
    return all(row["equal"] for row in rows)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.interest", description=(__doc__ or "").partition("\n")[0])
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--histories", type=int, default=100, help="how many are run (default: 100)")
    what.add_argument("--seed", type=int, help="run the history of this seed alone")
    what.add_argument("--mutants", action="store_true", help="look for a history that shows each wrong design")
    what.add_argument("--curves", action="store_true", help="measure what interest costs and spares")
    what.add_argument("--whole", type=int, metavar="N", help="what a building of so many rooms costs who holds all")
    what.add_argument("--fleets", metavar="N,N", help="count what one of so many robots gets, all in this process")
    what.add_argument("--machines", metavar="N,N", help="simulate so many machines behind a Zenoh router")
    parser.add_argument("--robots", type=int, default=2, help="robots of each machine (default: 2)")
    parser.add_argument("--routers", type=int, default=1, help="routers to which the machines are linked (default: 1)")
    parser.add_argument("--parts-only", action="store_true", help="do not measure fleets of which each holds all")
    parser.add_argument("--json", type=Path, help="write the curves to this file")
    parser.add_argument("--plot", type=Path, help="draw the curves into this file")
    return parser


if __name__ == "__main__":
    main()
