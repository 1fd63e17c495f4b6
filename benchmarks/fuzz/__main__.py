"""Mutated messages against every decoder and every key: no exception, no change of state, bounded memory.

    python -m benchmarks.fuzz --messages 1000000 --seed 1 --json fuzz.json

Exit 0 only if nothing went wrong. The same seed gives the same messages.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from benchmarks.fuzz.decoders import fuzz_decoder, targets
from benchmarks.fuzz.keys import fuzz_keys
from benchmarks.fuzz.tally import Tally

KEYS_SHARE = 0.25
"""of all messages go through the keys of a live memory, the others straight at decoders"""
_STRAIGHT = Console(stderr=True)


def main() -> None:
    """Fuzz as the command line asks and print a row for each decoder and key; exit 1 if something went wrong."""
    options = _parser().parse_args()
    logging.getLogger("dsr").addHandler(logging.NullHandler())  # what it says is counted, not shown
    logging.getLogger("agents").addHandler(logging.NullHandler())
    tallies: dict[str, Tally] = {}
    with Progress(console=_STRAIGHT, transient=True) as progress:
        task = progress.add_task("fuzzing", total=options.messages)
        for tally in fuzz(options.messages, options.seed):
            tallies[tally.name] = tally
            done = sum(each.messages for each in tallies.values())
            progress.update(task, completed=done, description=f"fuzzing {tally.name}")
    Console().print(_table(list(tallies.values())))
    for tally in tallies.values():
        for example in tally.examples:
            Console().print(f"{tally.name}: {example}", markup=False)
    if options.json:
        rows = [{**asdict(tally), "passed": tally.passed} for tally in tallies.values()]
        options.json.write_text(json.dumps({"seed": options.seed, "rows": rows}, indent=1), encoding="utf-8")
    raise SystemExit(0 if all(tally.passed for tally in tallies.values()) else 1)


def fuzz(messages: int, seed: int) -> Iterator[Tally]:
    """Everything; gives a tally now and then, each at least once when it is complete."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        os.environ["XDG_RUNTIME_DIR"] = f"{folder}/runtime"
        decoders = targets(Path(folder))
        straight = messages * (1 - KEYS_SHARE) / sum(target.share for target in decoders)
        for target in decoders:
            yield from fuzz_decoder(target, round(straight * target.share), seed)
        yield from fuzz_keys(round(messages * KEYS_SHARE), seed)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.fuzz", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--messages", type=int, default=100_000, help="how many (default: 100000)")
    parser.add_argument("--seed", type=int, default=1, help="of the mutations (default: 1)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser


def _table(tallies: list[Tally]) -> Table:
    table = Table(title=f"{sum(tally.messages for tally in tallies)} mutated messages")
    table.add_column("target", no_wrap=True)
    for heading in ("messages", "refused", "accepted", "raised", "changed", "miscounted", "MB", ""):
        table.add_column(heading, justify="right", no_wrap=bool(heading))
    for t in tallies:
        counts = (t.messages, t.refused, t.accepted, t.exceptions, t.changes, t.miscounted)
        table.add_row(t.name, *map(str, counts), f"{t.growth / 1e6:.1f}", "ok" if t.passed else "[red]FAILED[/red]")
    return table


if __name__ == "__main__":
    main()
