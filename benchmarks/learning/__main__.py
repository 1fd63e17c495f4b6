"""Learns the parameters of the weighted worlds and writes them to `etc/belief/worlds.toml`.

    python -m benchmarks.learning record --folder runs/learning --families hands pouring --seeds 100-104
    python -m benchmarks.learning fit --folder runs/learning

`record` plays episodes in lockstep and keeps evidence and truth; `fit` maximises the likelihood of the truth.
docs/explanation/worlds.md tells what the parameters mean. Episodes for judging are refused.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console
from rich.progress import track

from agents.scenario.generate.registry import FAMILIES, is_for_tuning
from agents.scenario.options import parse_seeds
from benchmarks.learning.learn import learn_parameters
from benchmarks.learning.recorded import record_episode
from simulation_handler.worlds.parameters import FILE

TUNING = [name for name, family in FAMILIES.items() if family.purpose == "tuning"]


def main() -> None:
    """Record or fit, as the command line asks."""
    options = _parser().parse_args()
    if options.command == "record":
        record(options.folder, options.families, parse_seeds(options.seeds))
    else:
        options.output.write_text(learn_parameters(options.folder, Console(stderr=True).print), encoding="utf-8")


def record(folder: Path, families: list[str], seeds: list[int]) -> None:
    """Record the episodes that are not in the folder yet."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(family, seed, folder / f"{family}-{seed}.pickle") for seed in seeds for family in families]
    refused = [f"{family}:{seed}" for family, seed, _ in jobs if not is_for_tuning(family, seed)]
    if refused:
        raise SystemExit(f"{', '.join(refused)}: for judging; nothing may be learned by them")
    todo = [job for job in jobs if not job[2].exists()]
    for family, seed, file in track(todo, "recording", console=Console(stderr=True)):
        record_episode(family, seed, "poses", file)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.learning", description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="play episodes and keep evidence and truth")
    recording.add_argument("--families", nargs="+", choices=TUNING, default=TUNING, help="default: all for tuning")
    recording.add_argument("--seeds", default="100-104", help="of the episodes, below 1000 (default: 100-104)")
    fitting = commands.add_parser("fit", help="learn by what was recorded")
    fitting.add_argument("--output", type=Path, default=FILE, help=f"default: {FILE.name} of the package")
    for command in (recording, fitting):
        command.add_argument("--folder", type=Path, required=True, help="of the recorded episodes")
    return parser


if __name__ == "__main__":
    main()
