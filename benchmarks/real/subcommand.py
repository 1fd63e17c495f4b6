"""What a measurement on a recording of others is: a module of this package with a `SUBCOMMAND`."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import benchmarks.real

SKIPPED = 3
"""Exit code if the recording is not there"""


class MissingDataError(Exception):
    """A folder does not hold the recording; says what is missing, without a full stop."""


@dataclass(frozen=True)
class Subcommand:
    """One measurement."""

    name: str
    text: str
    """One sentence for `--help`"""
    published: str
    """Where the recording comes from"""
    run: Callable[[Path, argparse.Namespace], list[dict[str, Any]]]
    """Measures on a folder, prints a table and returns its rows; may raise `MissingDataError`"""
    add_options: Callable[[argparse.ArgumentParser], None] = lambda _: None
    """Adds options beside --data, --seed and --json"""


def subcommands() -> dict[str, Subcommand]:
    """All there are, by name: those of modules in this package that have a `SUBCOMMAND`."""
    found = {}
    for module in pkgutil.iter_modules(benchmarks.real.__path__):
        if module.name != "__main__":
            one = getattr(importlib.import_module(f"benchmarks.real.{module.name}"), "SUBCOMMAND", None)
            if one is not None:
                found[one.name] = one
    return dict(sorted(found.items()))
