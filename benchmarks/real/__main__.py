"""`python -m benchmarks.real NAME ...`: one of the measurements on real images."""

from __future__ import annotations

import sys

from benchmarks.real import hands

NAMES = {"hands": hands.main}
"""Entries by name; each takes the arguments after its name."""

if __name__ == "__main__":
    name, *rest = sys.argv[1:] or ["--help"]
    if name not in NAMES:
        print(f"usage: python -m benchmarks.real {{{','.join(NAMES)}}} --help", file=sys.stderr)
        raise SystemExit(0 if name in ("-h", "--help") else 2)
    NAMES[name](rest)
