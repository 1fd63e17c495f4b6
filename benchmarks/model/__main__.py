"""Checks the model of how replicas join, remove and repair: every history within small bounds.

    python -m benchmarks.model                      # all promises, within all bounds
    python -m benchmarks.model --mutants            # each rule left out: something must be broken
    python -m benchmarks.model --parts              # parts of a graph: all promises, and each rule left out
    python -m benchmarks.model --make tests/dsr/properties/traces.json --seed 1
    python -m benchmarks.model --run tests/dsr/properties/traces.json

The last two make traces of the model, and run them against the real code. All but the last need java.
Exit 0 only if all is as it must be.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.model.checker import Bounds, CheckerError, PartsBounds, Verdict, check, check_parts
from benchmarks.model.replay import DiffersError, Room
from benchmarks.model.traces import WRONG, made, read, without, write

EXPLORED = (
    Bounds(changes=4),
    Bounds(changes=3, fetches=1),
    Bounds(changes=3, fetches=1, restarts=1, edges=False),
    Bounds(changes=2, fetches=2, restarts=1),
)
"""What is explored without an option: changes alone, with an answer, with a death too, with two answers and a death."""

PARTS = (PartsBounds(changes=3), PartsBounds(changes=3, fetches=1), PartsBounds(changes=2, fetches=1, moves=2))
"""What is explored of parts: changes and a move, with an answer, and with two moves."""
WRONG_PARTS = (
    "who does not hold the other part buries", "a replica id is used again", "who left answers as if it were empty",
)  # fmt: skip
"""Rules of parts that can be left out; then something is broken within `SHOWING`."""
SHOWING = PartsBounds(changes=3, fetches=1, moves=2)


def main() -> None:
    """Do what the command line asks for; exit 1 if something is not as it must be."""
    parser = argparse.ArgumentParser("python -m benchmarks.model", description=(__doc__ or "").partition("\n")[0])
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--mutants", action="store_true", help="leave each rule out: something must be broken")
    what.add_argument("--parts", action="store_true", help="the model of parts, and each of its rules left out")
    what.add_argument("--make", type=Path, metavar="FILE", help="make traces anew")
    what.add_argument("--run", type=Path, metavar="FILE", help="run traces against the real code")
    parser.add_argument("--seed", type=int, default=1, help="of random traces (default: 1)")
    options = parser.parse_args()
    try:
        if options.make:
            write(options.make, made(options.seed))
            right = True
        elif options.run:
            right = _run(options.run)
        else:
            right = _parts() if options.parts else _mutants() if options.mutants else _explore()
    except CheckerError as error:
        raise SystemExit(str(error)) from error
    raise SystemExit(0 if right else 1)


def _explore() -> bool:
    verdicts = []
    for bounds in EXPLORED:
        verdicts.append(check(bounds))
        _tell(str(bounds), verdicts[-1])
    return not any(verdict.broken for verdict in verdicts)


def _parts() -> bool:
    right = True
    for bounds in PARTS:
        verdict = check_parts(bounds)
        right = right and not verdict.broken
        _tell(str(bounds), verdict)
    for wrong in WRONG_PARTS:
        verdict = check_parts(SHOWING, wrong)
        right = right and bool(verdict.broken)
        _tell(wrong, verdict)
    return right


def _mutants() -> bool:
    seen = 0
    for wrong in WRONG:
        verdict = without(wrong).verdict
        seen += bool(verdict.broken)
        _tell(wrong, verdict)
    print(f"{seen} of {len(WRONG)} rules are needed")
    return seen == len(WRONG)


def _tell(what: str, verdict: Verdict) -> None:
    print(f"{what}: {verdict.distinct} states, {verdict.broken or 'nothing'} broken", flush=True)
    for state in verdict.states[1:]:
        last = state["last"]
        print(f"    {last['do']} at {last['site']} {last['with'] or ''}")


def _run(file: Path) -> bool:
    traces = read(file)
    wrong = 0
    for trace in traces.traces:
        try:
            room = Room(traces.sites)
            room.run(trace.steps)
            room.heal()
        except DiffersError as error:
            wrong += 1
            print(f"{trace.why}: {error}")
    print(f"{len(traces.traces) - wrong} of {len(traces.traces)} traces are those of the real code")
    return not wrong


if __name__ == "__main__":
    main()
