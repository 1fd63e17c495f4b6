"""Options that several commands about scenarios have in common."""

from __future__ import annotations

import enum
import re
from typing import Annotated

import typer

from agents.scenario.format.scenario import scenario_files
from dsr.errors import ConfigError

MOST_SEEDS = 100_000
_PART = re.compile(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?")


class SensorChoice(enum.StrEnum):
    """Values of `--sensor`."""

    PIXELS = "pixels"
    POSES = "poses"


class HandFinderChoice(enum.StrEnum):
    """Values of `--hands`."""

    MODEL = "model"
    COLOUR = "colour"


Hands = Annotated[
    HandFinderChoice | None,
    typer.Option(help="Find hands in images by the real model or by colour; default: the system's way."),
]
UntaggedOption = Annotated[
    bool,
    typer.Option("--untagged", help="Without tags: boxes and cylinders are found by depth (needs `--sensor pixels`)."),
]


def complete_scenario(incomplete: str) -> list[str]:
    """The names of scenarios that the shell completes; nothing for a path, which it completes itself."""
    return [name for name in scenario_files() if name.startswith(incomplete)]


def parse_seeds(text: str, option: str = "--seeds") -> list[int]:
    """The seeds of `0-49`, `7` or `0-9,20-29`, each once. Raises `ConfigError`, which names the `option`."""
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = _PART.fullmatch(part)
        if match is None:
            raise ConfigError(f"{option} {text!r}: expected numbers and ranges, like 0-49 or 3,7,20-29; got {part!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise ConfigError(f"{option} {text!r}: {part.strip()!r} ends before it begins")
        if last - first >= MOST_SEEDS:
            raise ConfigError(f"{option} {text!r}: expected at most {MOST_SEEDS} seeds")
        seeds |= dict.fromkeys(range(first, last + 1))
    return list(seeds)
