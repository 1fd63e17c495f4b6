"""Is what cannot happen more surprising than what can? Surprise of the belief on the human test of ADEPT.

    python -m benchmarks.adept --data DIR
    python -m benchmarks.adept --data DIR --shape cube --row vanish --json adept.json

The data are not part of the project: files such as `cube/block_cube_0.json.gz`, a folder for each shape, made from the
human test of ADEPT (Smith et al., NeurIPS 2019; github.com/JerryLingjieMei/ADEPT-Dataset-Release, MIT). Without --data
the benchmark is skipped, and says so.

A case's surprise is its greatest. Relative accuracy is how often the case that violates physics has more surprise than
its control; a tie counts a half. The mean is taken over rows and shapes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import fmean

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from benchmarks.adept.cases import ROWS, Case, read_case
from benchmarks.adept.naive import LastPercept
from benchmarks.adept.unseen.ghosts import Mechanics
from benchmarks.adept.unseen.rates import EventRates
from benchmarks.adept.unseen.supposing import Supposing
from benchmarks.options import whole_number
from benchmarks.real.recordings import DataError
from dsr.cli.common import add_names, add_numbers

MECHANICS = Mechanics(gravity=1.0, friction=0.0, restitution=0.9)
"""The physics of the data set, which the belief is told"""
WINDOW = 1.0
"""s of what is seen that are judged together"""
METHODS = ("belief", "last percept")

Scores = dict[str, dict[str, float]]
"""Of each method, the greatest surprise of each case, nats"""


def main() -> int:
    """Run what the command line asks for; 0 if it ran or was skipped, 2 if the data are wrong."""
    options = _parser().parse_args()
    if options.data is None:
        print("adept: skipped, for --data is not given; python -m benchmarks.adept --help tells where the data are")
        return 0
    try:
        figures = {shape: dict(_rows(options.data, shape, options)) for shape in _shapes(options.data, options.shape)}
    except (DataError, OSError) as error:
        print(f"adept: {error}")
        return 2
    _show(figures)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    return 0


def _rows(data: Path, shape: str, options: argparse.Namespace) -> Iterator[tuple[str, dict[str, object]]]:
    """Of each row, the accuracy and the scores of each method."""
    known: dict[Path, dict[str, float]] = {}
    for row in options.row or ROWS:
        name, violation, controls = ROWS[row]
        paths = [data / shape / f"{name}_{shape}_{variant}.json.gz" for variant in (violation, *controls)]
        for path in paths:
            if path not in known:
                known[path] = scores(read_case(path), seed=options.seed)
                print(f"{path.name}: {', '.join(f'{key} {nats:.2f}' for key, nats in known[path].items())} nats",
                      file=sys.stderr, flush=True)  # fmt: skip
        yield row, {
            method: {
                "accuracy": accuracy(known[paths[0]][method], [known[path][method] for path in paths[1:]]),
                "nats": [known[path][method] for path in paths],
            }
            for method in METHODS
        }  # fmt: skip


def scores(case: Case, prior: EventRates | None = None, seed: int = 0) -> dict[str, float]:
    """The greatest surprise of a case by each method, nats."""
    prior = prior or EventRates()
    rate = 1.0 / (case.moments[1].time - case.moments[0].time)
    belief, naive = Supposing(MECHANICS, prior, WINDOW, rate, seed), LastPercept(prior.resolution)
    greatest = dict.fromkeys(METHODS, 0.0)
    for time, sight, percepts in case.moments:
        greatest["belief"] = max(greatest["belief"], belief.step(time, sight, percepts).nats)
        greatest["last percept"] = max(greatest["last percept"], naive.step(percepts))
    belief.close()
    return greatest


def accuracy(violation: float, controls: list[float]) -> float:
    """How often a violation is more surprising than its controls; a tie counts a half."""
    return fmean(1.0 if violation > control else 0.5 * (violation == control) for control in controls)


def _shapes(data: Path, chosen: list[str] | None) -> list[str]:
    found = sorted(folder.name for folder in data.iterdir() if folder.is_dir())
    shapes = chosen or found
    if missing := [shape for shape in shapes if shape not in found]:
        raise DataError(f"{data}: no folder {missing[0]!r}; there are {', '.join(found) or 'none'}")
    if not shapes:
        raise DataError(f"{data}: no folders with cases")
    return shapes


def _show(figures: Mapping[str, Mapping[str, dict[str, object]]]) -> None:
    table = Table(title="relative accuracy", box=SIMPLE_HEAD)
    add_names(table, "row")
    add_numbers(table, *METHODS)
    rows = {row for shape in figures.values() for row in shape}
    for row in (row for row in ROWS if row in rows):
        means = [fmean(shape[row][method]["accuracy"] for shape in figures.values()) for method in METHODS]  # type: ignore[index]
        table.add_row(row, *(f"{mean:.2f}" for mean in means))
    means = [
        fmean(values[method]["accuracy"] for shape in figures.values() for values in shape.values())  # type: ignore[index]
        for method in METHODS
    ]
    table.add_row("all", *(f"{mean:.3f}" for mean in means))
    Console().print(table)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.adept", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder with a folder for each shape")
    parser.add_argument("--shape", action="append", metavar="NAME", help="only this shape; repeatable")
    parser.add_argument("--row", action="append", choices=list(ROWS), help="only this row; repeatable")
    parser.add_argument(
        "--seed", type=whole_number(0), default=0, metavar="N", help="of the motions that the belief draws"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there, too")
    return parser


if __name__ == "__main__":
    sys.exit(main())
