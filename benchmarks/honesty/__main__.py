"""How honest is the belief? Plays random episodes and scores what is believed as a distribution.

    python -m benchmarks.honesty --families stacks hands --seeds 0-9
    python -m benchmarks.honesty --seeds 0-2 --markdown --pictures docs/images

The peer is the last percept, with the sensor's covariance. docs/explanation/honesty.md tells what the scores mean.
"""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import track

from agents.scenario.generate.registry import FAMILIES
from benchmarks.honesty.moments import RunScores
from benchmarks.honesty.runs import Job, play_all
from benchmarks.honesty.summary import summarise_runs
from benchmarks.honesty.tables import markdown, show_report
from benchmarks.options import seeds, whole_number

FIRST_SEEDS = range(3)
"""Seeds of the episodes that are played unless somebody asks for others"""


def main() -> None:
    """Play what the command line asks for, or read what was played before, and print the scores."""
    options = _parser().parse_args()
    if options.pictures and find_spec("matplotlib") is None:
        sys.exit("pictures need matplotlib: pip install 'dsr-memory[bench]'")
    runs = _kept(options) if options.read else _played(options)
    if options.write:
        options.write.write_bytes(msgspec.msgpack.encode(runs))
    report = summarise_runs(runs)
    if options.markdown:
        print(markdown(report))
    else:
        show_report(report, Console())
    if options.json:
        options.json.write_bytes(msgspec.json.encode(report))
    if options.pictures:
        from benchmarks.honesty.pictures import draw_pictures

        for file in draw_pictures(runs, report, options.pictures):
            Console(stderr=True).print(str(file))


def _played(options: argparse.Namespace) -> list[RunScores]:
    jobs = [
        Job(family, seed, options.sensor) for family in options.families for seed in options.seeds or FIRST_SEEDS
    ]
    played = play_all(jobs, options.processes)
    return list(track(played, "playing", total=len(jobs), console=Console(stderr=True)))


def _kept(options: argparse.Namespace) -> list[RunScores]:
    """What was kept of the families and seeds that are asked for."""
    try:
        runs = msgspec.msgpack.decode(options.read.read_bytes(), type=list[RunScores])
    except (OSError, msgspec.DecodeError) as error:
        sys.exit(f"{options.read} is not what --write wrote: {error}")
    seeds = options.seeds or {run.seed for run in runs}
    chosen = [run for run in runs if run.family in options.families and run.seed in seeds]
    return chosen or sys.exit(f"{options.read} has nothing of these families and seeds")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.honesty", description=__doc__.partition("\n")[0])
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES), help="default: all")
    parser.add_argument(
        "--seeds", type=seeds, help="of the episodes, such as 0-9 or 3,7 (default: 0-2; of what is read: all)"
    )
    parser.add_argument("--sensor", choices=("poses", "pixels"), default="poses", help="default: poses")
    parser.add_argument("--processes", type=whole_number(1), default=2, help="episodes at a time (default: 2)")
    parser.add_argument("--markdown", action="store_true", help="print the tables in Markdown")
    parser.add_argument("--json", type=Path, help="write the scores to this file, too")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw pictures (needs the extra `bench`)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="keep all that was told, for `--read`")
    parser.add_argument("--read", type=Path, metavar="FILE", help="sum up what was kept of these families and seeds")
    return parser


if __name__ == "__main__":
    main()
