"""The scenario file format: read one with `load_scenario`; everything a reader needs is exported here.

The struct of the file is `Scenario` (model.py), of the moves `Event` (events.py), of what must hold `Check`
(expectations.py). docs/reference/scenarios.md describes the format for users.

Time: the plant simulates from the moment it runs, but the timeline starts when a `Start` arrives
(dsr/vocabulary/scenario_start.py); until then nothing of `events` happens. The runner repeats the message once a
second, so a plant that was restarted carries on at the right time.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from agents.scenario.format.checks import inconsistencies
from agents.scenario.format.conditions import PREDICATES, Condition, Term
from agents.scenario.format.events import (
    EVENTS,
    ArmError,
    CameraBump,
    CameraCover,
    Carry,
    Drop,
    Event,
    FalsePercept,
    HandEnter,
    HandGraspEvent,
    HandLeave,
    HandMove,
    HandRelease,
    Kill,
    Lift,
    PersonEnter,
    PersonLeave,
    PersonTurn,
    PersonWalk,
    PlaceEvent,
    Push,
    Remove,
    Roll,
    SetInMotion,
    Slide,
    Swap,
    Tilt,
    Topple,
)
from agents.scenario.format.expectations import Check
from agents.scenario.format.explain import syntax_error, type_error, value_error
from agents.scenario.format.inconsistency import InconsistencyError
from agents.scenario.format.layout import start_poses
from agents.scenario.format.model import (
    ArmSpec,
    CameraSpec,
    MissionSpec,
    ObjectSpec,
    PersonSpec,
    RandomSpec,
    RobotSpec,
    Scenario,
    SensorSpec,
    TableSpec,
)
from agents.scenario.format.models import with_models
from agents.scenario.format.untagged import untagged
from dsr.config.toml_lines import Path as ValuePath
from dsr.config.toml_lines import parse_toml
from dsr.errors import ConfigError, suggest
from dsr.files.built_in import ETC
from dsr.files.data_files import read_text

__all__ = [
    "EVENTS",
    "PREDICATES",
    "ArmError",
    "ArmSpec",
    "CameraBump",
    "CameraCover",
    "CameraSpec",
    "Carry",
    "Check",
    "Condition",
    "Drop",
    "Event",
    "FalsePercept",
    "HandEnter",
    "HandGraspEvent",
    "HandLeave",
    "HandMove",
    "HandRelease",
    "Kill",
    "Lift",
    "MissionSpec",
    "ObjectSpec",
    "PersonEnter",
    "PersonLeave",
    "PersonSpec",
    "PersonTurn",
    "PersonWalk",
    "PlaceEvent",
    "Push",
    "RandomSpec",
    "Remove",
    "RobotSpec",
    "Roll",
    "Scenario",
    "SensorSpec",
    "SetInMotion",
    "Slide",
    "Swap",
    "TableSpec",
    "Term",
    "Tilt",
    "Topple",
    "find_scenario",
    "load_scenario",
    "parse_scenario",
    "scenario_files",
    "start_poses",
]


def load_scenario(name_or_path: str | Path, *, without_tags: bool = False) -> Scenario:
    """The scenario of a file, or the built-in one of that name. Raises `ConfigError`.

    Args:
        name_or_path: a built-in scenario or a file.
        without_tags: its variant with blocks that nobody tagged, see `untagged`.
    """
    file = find_scenario(name_or_path)
    scenario = parse_scenario(read_text(file), str(file))
    return untagged(scenario) if without_tags else scenario


def find_scenario(name_or_path: str | Path) -> Path:
    """The file of a scenario: a path ending in `.toml`, or the name of a built-in one."""
    path = Path(name_or_path)
    if path.suffix == ".toml":
        return path
    known = scenario_files()
    if str(name_or_path) not in known:
        if path.exists():
            raise ConfigError(f"{path}: no scenario file; expected a file whose name ends in .toml")
        raise ConfigError(f"unknown scenario {str(name_or_path)!r}; {suggest(str(name_or_path), known)}")
    return known[str(name_or_path)]


def scenario_files() -> dict[str, Path]:
    """Built-in scenarios by name: `etc/scenarios` here or where the package is installed from."""
    folders = (ETC / "scenarios", Path("etc/scenarios"))
    return {file.stem: file for folder in folders for file in sorted(folder.glob("*.toml"))}


def parse_scenario(text: str, file: str = "<text>") -> Scenario:
    """The scenario written in `text`; `file` is named in errors. Raises `ConfigError`."""
    try:
        data = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise syntax_error(error, text, file) from error
    except RecursionError as error:
        raise ConfigError("not valid TOML: nested too deeply", file=file) from error
    for path, value in _floats(data, ()):
        if not math.isfinite(value):
            raise value_error(f"expected a finite number, got {value}", path, text, file)
    try:
        scenario = msgspec.convert(data, Scenario)
    except msgspec.ValidationError as error:
        raise type_error(error, data, text, file) from error
    try:
        folder = Path(file).parent
        scenario = with_models(scenario, data, folder)
    except InconsistencyError as error:
        raise value_error(str(error), error.path, text, file) from error
    etc = ETC if ETC.is_dir() else None
    errors = [value_error(str(error), error.path, text, file) for error in inconsistencies(scenario, etc, folder)]
    if len(errors) > 1:
        raise ConfigError(f"{len(errors)} errors:\n" + "\n".join(map(str, errors)))
    if errors:
        raise errors[0]
    return scenario


def _floats(value: Any, path: ValuePath) -> Iterator[tuple[ValuePath, float]]:
    """All floating-point numbers in parsed TOML with their paths."""
    if isinstance(value, float):
        yield path, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _floats(item, (*path, key))
