"""How accurate is perception on recordings of others? Ours beside its peers, in the same run.

    python -m benchmarks.real tags --data DIR
    python -m benchmarks.real tags --data DIR --pictures OUT
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

import cv2
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
        if options.pictures:
            return _draw(benchmark, options.data, options.pictures)
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


def _draw(benchmark: RealBenchmark, data: Path, out: Path) -> int:
    """Write what is found, drawn into the images, to a folder; 0 if there were any."""
    assert benchmark.draw is not None
    out.mkdir(parents=True, exist_ok=True)
    written = [name for name, picture in benchmark.draw(data) if cv2.imwrite(str(out / name), picture)]
    print(f"{benchmark.name}: {len(written)} pictures in {out}")
    return 0 if written else 2


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
        if benchmark.draw is not None:
            command.add_argument("--pictures", type=Path, metavar="OUT", help="only draw what is found, to this folder")
        command.set_defaults(benchmark=benchmark, pictures=None)
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
