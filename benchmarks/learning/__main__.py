"""Learns the parameters of the weighted worlds and writes them to `etc/belief/worlds.toml`.

    python -m benchmarks.learning record --folder runs/learning --families hands pouring --seeds 100-104
    python -m benchmarks.learning recognise --families screens --seeds 100-149
    python -m benchmarks.learning fit --folder runs/learning
    python -m benchmarks.learning judge --folder runs/judging

`record` plays episodes in lockstep and keeps evidence and truth. `recognise` plays them by the plant alone, and learns
how much cameras must see of a thing. `fit` maximises the likelihood of the truth, without
episodes for judging. `judge` compares weighted worlds with the one simulated world, of all episodes of a folder.
docs/explanation/worlds.md tells what the parameters mean.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

from rich.console import Console
from rich.progress import track

from agents.scenario.generate.registry import FAMILIES, FIRST_JUDGING_SEED
from agents.scenario.options import parse_seeds
from agents.scenario.run.staging import Sensor
from benchmarks.learning.holding import HOLDING
from benchmarks.learning.judging import judge_episodes, table_of
from benchmarks.learning.learn import VALUES, learn_parameters, learn_some, learn_to_recognise, load_episodes
from benchmarks.learning.recorded import record_episode
from dsr.believing.absence import LEARNED
from simulation_handler.worlds.circumstances import CIRCUMSTANCES
from simulation_handler.worlds.parameters import learned_parameters

TUNING = [name for name, family in FAMILIES.items() if family.purpose == "tuning"]


_WIDTH = 150  # characters of the table


def main() -> None:
    """Record or fit, as the command line asks."""
    options = _parser().parse_args()
    if options.command == "record":
        record(options.folder, options.families, parse_seeds(options.seeds), options.sensor)
    elif options.command == "judge":
        Console(width=_WIDTH).print(table_of(judge_episodes(load_episodes(options.folder), learned_parameters())))
    elif options.command == "recognise":
        seeds = _for_tuning(parse_seeds(options.seeds))
        text = learn_to_recognise(options.families, seeds, LEARNED, Console(stderr=True).print)
        options.output.write_text(text, encoding="utf-8")
    else:
        tell = Console(stderr=True).print
        text = (
            learn_some(options.folder, options.only, LEARNED, tell)
            if options.only
            else learn_parameters(options.folder, tell)
        )
        options.output.write_text(text, encoding="utf-8")


def record(folder: Path, families: list[str], seeds: list[int], sensor: Sensor = "poses") -> None:
    """Record the episodes that are not in the folder yet. Nobody looks at seeds for judging alone."""
    seeds = _for_tuning(seeds)
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(family, seed, folder / f"{family}-{seed}.pickle") for seed in seeds for family in families]
    todo = [job for job in jobs if not job[2].exists()]
    for family, seed, file in track(todo, "recording", console=Console(stderr=True)):
        record_episode(family, seed, sensor, file)


def _for_tuning(seeds: list[int]) -> list[int]:
    if refused := [seed for seed in seeds if seed >= FIRST_JUDGING_SEED]:
        raise SystemExit(f"seeds {refused}: for judging alone; expected less than {FIRST_JUDGING_SEED}")
    return seeds


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.learning", description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="play episodes and keep evidence and truth")
    recording.add_argument("--families", nargs="+", choices=FAMILIES, default=TUNING, help="default: all for tuning")
    recording.add_argument("--seeds", default="100-104", help="of the episodes, below 1000 (default: 100-104)")
    recording.add_argument("--sensor", choices=get_args(Sensor), default="poses", help="pixels draws images")
    recognising = commands.add_parser("recognise", help="learn how much cameras must see of a thing to recognise it")
    recognising.add_argument("--families", nargs="+", choices=TUNING, default=TUNING, help="default: all for tuning")
    recognising.add_argument("--seeds", default="100-149", help="of the episodes, below 1000 (default: 100-149)")
    fitting = commands.add_parser("fit", help="learn by what was recorded")
    for command in (recognising, fitting):
        command.add_argument("--output", type=Path, default=LEARNED, help=f"default: {LEARNED.name} of the package")
    fitting.add_argument(
        "--only", nargs="+", choices=(HOLDING, *sorted(VALUES), *CIRCUMSTANCES), metavar="WHAT",
        help=f"learn {HOLDING}, absence, elsewhere, some rates, or noise of circumstances, alone",
    )  # fmt: skip
    judging = commands.add_parser("judge", help="compare weighted worlds with the simulated world")
    for command in (recording, fitting, judging):
        command.add_argument("--folder", type=Path, required=True, help="of the recorded episodes")
    return parser


if __name__ == "__main__":
    main()
