"""Measure on recordings of others: `python -m benchmarks.real NAME --data DIR`.

    python -m benchmarks.real --help            # what can be measured, and where the recordings are published
    python -m benchmarks.real hand-eye --data DIR --json hand_eye.json

Exit 0 if it was measured, 3 if it was skipped because the recording is not there.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.real.subcommand import SKIPPED, MissingDataError, Subcommand, subcommands


def main() -> int:
    """Measure what the command line names."""
    known = subcommands()
    options = _parser(known).parse_args()
    chosen = known[options.name]
    try:
        if not options.data.is_dir():
            raise MissingDataError(f"there is no folder {options.data}")
        rows = chosen.run(options.data, options)
    except MissingDataError as error:
        sys.stderr.write(f"skipped: {error}. The recording is published at {chosen.published}\n")
        return SKIPPED
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    return 0


def _parser(known: dict[str, Subcommand]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.real", description=(__doc__ or "").partition("\n")[0])
    names = parser.add_subparsers(dest="name", required=True, metavar="NAME")
    for name, one in known.items():
        text = f"{one.text} Published at {one.published}."
        sub = names.add_parser(name, help=one.text, description=text)
        sub.add_argument("--data", type=Path, required=True, metavar="DIR", help=f"a copy of {one.published}")
        sub.add_argument("--seed", type=int, default=0, help="of random choices (default: 0)")
        sub.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file")
        one.add_options(sub)
    return parser


if __name__ == "__main__":
    sys.exit(main())
