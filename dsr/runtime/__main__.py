"""Runs an agent class as a process: `python -m dsr.runtime [--beside FOLDER] module:Class --graph ...`."""

import sys
from pathlib import Path

from dsr.errors import ConfigError
from dsr.runtime.agent_process import run_command_line
from dsr.runtime.orders import EXIT_USAGE
from dsr.runtime.resources import exit_if_short
from dsr.runtime.system import load_class


def main() -> int:
    """Run it; returns the exit code. Modules in the folder are found after those that are installed."""
    exit_if_short()
    arguments, folder = sys.argv[1:], None
    if arguments[:1] == ["--beside"]:
        folder, arguments = Path(arguments[1]), arguments[2:]
    name, *arguments = arguments or [""]
    try:
        kind = load_class(name, folder)
    except ConfigError as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_USAGE
    return run_command_line(kind, arguments)


if __name__ == "__main__":
    sys.exit(main())
