"""Runs the agent class that is named as a process: `python -m dsr.runtime module:Class --graph ...`."""

import sys

from dsr.errors import ConfigError
from dsr.runtime.agent_process import EXIT_USAGE, run_command_line
from dsr.runtime.resources import exit_if_short
from dsr.runtime.system import load_class


def main() -> int:
    """Run it; returns the exit code."""
    exit_if_short()
    name, *arguments = sys.argv[1:] or [""]
    try:
        kind = load_class(name)
    except ConfigError as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_USAGE
    return run_command_line(kind, arguments)


if __name__ == "__main__":
    sys.exit(main())
