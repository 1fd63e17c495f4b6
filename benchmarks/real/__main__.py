"""How accurate is perception on recordings of others? Ours beside its peers, in the same run.

    python -m benchmarks.real tags --data DIR
    python -m benchmarks.real block --data DIR --json block.json
    python -m benchmarks.real hands --data DIR --mediapipe PYTHON

The recordings are not part of the project: `python -m benchmarks.real NAME --help` tells where each is published and
what of it is needed. Without --data a benchmark is skipped, and says so.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rich.console import Console

from benchmarks.real import block, boxes, gen3, hand_eye, hands, tags
from benchmarks.real.recordings import DataError, RealBenchmark

BENCHMARKS: tuple[RealBenchmark, ...] = (
    tags.BENCHMARK,
    boxes.BENCHMARK,
    block.BENCHMARK,
    hand_eye.BENCHMARK,
    gen3.BENCHMARK,
)


def main() -> int:
    """Run what the command line asks for; 0 if it ran or was skipped, 2 if its recordings are wrong."""
    if sys.argv[1:2] == [hands.NAME]:  # which has options of its own
        hands.main(sys.argv[2:])
        return 0
    options = _parser().parse_args()
    benchmark: RealBenchmark = options.benchmark
    if options.data is None:
        print(f"{benchmark.name}: skipped, for --data is not given\n{benchmark.published}")
        return 0
    try:
        outcome = benchmark.run(options.data)
    except (DataError, OSError) as error:
        print(f"{benchmark.name}: {error}\n{benchmark.published}")
        return 2
    console = Console()
    console.print(outcome.table)
    for remark in outcome.remarks:
        console.print(remark)
    if options.json:
        options.json.write_text(json.dumps(outcome.figures, indent=1), encoding="utf-8")
    return 0


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("python -m benchmarks.real", description=__doc__, formatter_class=raw)
    commands = parser.add_subparsers(required=True, metavar="NAME")
    commands.add_parser(hands.NAME, help="hands in photos, beside MediaPipe's own programs", add_help=False)
    for benchmark in BENCHMARKS:
        text = f"{benchmark.what}\n\n{benchmark.published}"
        command = commands.add_parser(
            benchmark.name, help=benchmark.what.splitlines()[0], description=text, formatter_class=raw
        )
        command.add_argument("--data", type=Path, metavar="DIR", help="the folder with the recordings")
        command.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to this file")
        command.set_defaults(benchmark=benchmark)
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
