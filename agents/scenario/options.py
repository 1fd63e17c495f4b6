"""Options that several commands about scenarios have in common."""

from __future__ import annotations

import enum
from typing import Annotated

import typer

from agents.scenario.format.scenario import scenario_files


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
