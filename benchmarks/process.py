"""The process in which one group is measured: `python -m benchmarks.process GROUP`; it reports JSON lines."""

from __future__ import annotations

import argparse
import os
import sys
import threading

import msgspec

from benchmarks.group import Message, Run
from benchmarks.groups import GROUPS, find
from dsr.errors import DsrError
from dsr.runtime.lifeline import follow_launcher

FAILED = 3
"""Exit code after an error that the last line on stderr tells."""


def main() -> None:
    """Measure the group that the command line names, thorough or quick."""
    parser = argparse.ArgumentParser("python -m benchmarks.process")
    parser.add_argument("group", choices=[group.name for group in GROUPS])
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    follow_launcher(os.environ, threading.Event())
    try:
        find(options.group).measure(Run(_tell, quick=options.quick))
    except DsrError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(FAILED)


def _tell(message: Message) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(message) + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
