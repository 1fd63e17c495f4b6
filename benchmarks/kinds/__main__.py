"""How often does each kind of failure of the belief occur? Plays random episodes that are drawn to show it.

    python -m benchmarks.kinds --episodes 20 --first 1000
    python -m benchmarks.kinds --episodes 5 --first 0 --kind lying rolled --failures

What is believed is compared with the plant's truth, with the sensor `poses`. Seeds from 1000 on are for judging.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from rich.console import Console
from rich.progress import track

from benchmarks.kinds.cases import KINDS, Case
from benchmarks.kinds.playing import Job, play_all
from benchmarks.options import whole_number

SURE = 0.9
"""1, probability from which what is wrong is told surely: an honest belief is wrong in a tenth of such cases"""
LASTING = 5
"""Moments (0.1 s) at which a failure shows of one thing until it counts for the episode: not a delay of percepts"""


class Row(NamedTuple):
    """What was found of one kind."""

    kind: str
    failure: str
    episodes: int
    """In which it may show"""
    failed: int
    """Of these, in which it lasts"""
    sure: int
    """Of these, in which it lasts and is told with `SURE`"""
    moments: int
    wrong: float
    """Share of the moments"""
    sure_and_wrong: float
    """Share of the moments"""


def main() -> None:
    """Play what the command line asks for, and print a row for each kind."""
    options = _parser().parse_args()
    if options.read:
        found = _kept(options.read)
    else:
        scenes = dict.fromkeys(KINDS[kind][0] for kind in options.kind)
        jobs = [Job(scene, options.first + number) for number in range(options.episodes) for scene in scenes]
        played = track(play_all(jobs, options.processes), "playing", total=len(jobs), console=Console(stderr=True))
        found = []
        for of_one in played:
            found += of_one
            if options.write:
                options.write.write_bytes(msgspec.msgpack.encode(found))
    print(markdown(rows([case for case in found if case.kind in options.kind])))
    if options.failures:
        for (kind, seed, name), count in sorted(Counter(case[:3] for case in found if case.wrong).items()):
            print(f"{kind}: {name} of seed {seed}, {count} moments")


def _kept(file: Path) -> list[Case]:
    """What `--write` kept."""
    try:
        return msgspec.msgpack.decode(file.read_bytes(), type=list[Case])
    except (OSError, msgspec.DecodeError) as error:
        sys.exit(f"{file} is not what --write wrote: {error}")


def rows(found: Sequence[Case]) -> list[Row]:
    """One row for each kind that may have shown, in the order of `KINDS`."""
    result = []
    for kind, (_, failure) in KINDS.items():
        of_kind = [case for case in found if case.kind == kind]
        if of_kind:
            wrong = [case for case in of_kind if case.wrong]
            sure = [case for case in wrong if case.told >= SURE]
            result.append(
                Row(
                    kind=kind,
                    failure=failure,
                    episodes=len({case.seed for case in of_kind}),
                    failed=_lasting(of_kind, wrong),
                    sure=_lasting(of_kind, sure),
                    moments=len(of_kind),
                    wrong=len(wrong) / len(of_kind),
                    sure_and_wrong=len(sure) / len(of_kind),
                )
            )
    return result


def _lasting(of_kind: Sequence[Case], failures: Sequence[Case]) -> int:
    """Episodes in which a failure lasts, or shows each time that it may."""
    may, does = (Counter((case.seed, case.object) for case in some) for some in (of_kind, failures))
    return len({seed for (seed, name), count in does.items() if count >= min(LASTING, may[seed, name])})


def markdown(found: Sequence[Row]) -> str:
    """The rows as a table in Markdown."""
    lines = ["| kind | failure | episodes | failed | sure | moments | wrong | sure and wrong |", "|" + "---|" * 8]
    lines += [
        f"| {row.kind} | {row.failure} | {row.episodes} | {row.failed} | {row.sure} | {row.moments} "
        f"| {row.wrong:.0%} | {row.sure_and_wrong:.0%} |"
        for row in found
    ]
    return "\n".join(lines)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.kinds", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS), help="default: all")
    parser.add_argument("--episodes", type=whole_number(1), default=5, help="of each scene (default: 5)")
    parser.add_argument("--first", type=whole_number(0), default=0, help="seed of the first episode (default: 0)")
    parser.add_argument("--processes", type=whole_number(1), default=2, help="episodes at a time (default: 2)")
    parser.add_argument("--failures", action="store_true", help="list the things that were believed wrongly, too")
    parser.add_argument("--write", type=Path, metavar="FILE", help="keep all cases as they come, for `--read`")
    parser.add_argument("--read", type=Path, metavar="FILE", help="sum up what was kept, and play nothing")
    return parser


if __name__ == "__main__":
    main()
