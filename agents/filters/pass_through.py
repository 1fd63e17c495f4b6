"""Copies a world into another one, or several into one."""

from __future__ import annotations

from dsr import main
from dsr.worlds import Filter


class PassThrough(Filter):
    """Passes on everything. With several worlds to read it merges them, see its configuration `conflict`."""

    name = "pass_through"


if __name__ == "__main__":
    main(PassThrough)
