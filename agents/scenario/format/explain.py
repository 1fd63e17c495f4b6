"""Errors about a scenario file: the line, the field, and the expected content."""

from __future__ import annotations

import re
import tomllib
from typing import Any, Literal, get_args, get_origin

import msgspec

from agents.scenario.format.events import EVENTS
from agents.scenario.format.expectations import CHECKS
from agents.scenario.format.model import (
    ArmSpec,
    CameraSpec,
    MissionSpec,
    ObjectSpec,
    PersonSpec,
    PlanSpec,
    RandomSpec,
    RobotSpec,
    Scenario,
    SensorSpec,
    TableSpec,
)
from agents.scenario.format.units import UNITS
from dsr.config.toml_lines import Path, line_of
from dsr.errors import ConfigError, suggest

_AT = re.compile(r" - at `\$(?P<path>.*)`$")
_STEP = re.compile(r"\.(\w+)|\[(\d+)\]")
_UNKNOWN_FIELD = re.compile(r"unknown field `(.*)`")
_SECTIONS: dict[str, type[msgspec.Struct]] = {
    "robot": RobotSpec,
    "arm": ArmSpec,
    "camera": CameraSpec,
    "table": TableSpec,
    "sensor": SensorSpec,
    "random": RandomSpec,
    "mission": MissionSpec,
    "object": ObjectSpec,
    "person": PersonSpec,
    "plan": PlanSpec,
}
_TAGGED: dict[str, tuple[str, dict[str, Any]]] = {"event": ("do", EVENTS), "expect": ("check", CHECKS)}


def value_error(message: str, path: Path, text: str, file: str) -> ConfigError:
    """`message` about the value at `path` of the TOML `text`; elements of lists are counted from 1."""
    place = ".".join(str(step + 1) if isinstance(step, int) else step for step in path)
    return ConfigError(f"{place}: {message}" if place else message, file=file, line=line_of(text, path))


def syntax_error(error: tomllib.TOMLDecodeError, text: str, file: str) -> ConfigError:
    """The TOML parser's message, with its line (of the end, if that came too early) moved to the front."""
    message, _, place = str(error).partition(" (at ")
    line = re.search(r"line (\d+)", place)
    number = int(line[1]) if line else len(text.splitlines())
    return ConfigError(f"not valid TOML: {message}", file=file, line=number)


def type_error(error: msgspec.ValidationError, data: dict[str, Any], text: str, file: str) -> ConfigError:
    """A validation error with the field, its unit and the valid names."""
    message = str(error)
    match = _AT.search(message)
    path = _value_path(match["path"]) if match else ()
    what = (message[: match.start()] if match else message).removeprefix("Object ")
    if unknown := _UNKNOWN_FIELD.search(what):
        path += (unknown[1],)
        what = f"unknown field; {suggest(unknown[1], _fields(path[:-1], data))}"
    elif what.startswith("Invalid"):
        what = f"unknown value {_value(path, data)!r}; {suggest(str(_value(path, data)), _choices(path, data))}"
    elif what.endswith(("missing required field `do`", "missing required field `check`")):
        what += f"; {suggest('', _TAGGED[str(path[0])][1])}"
    elif what.startswith("Expected"):
        expected = what.partition(", got ")[0].replace("`object`", "`table`")
        what = f"{expected}{_unit(path)}, got {_value(path, data)!r}"
    return value_error(what[0].lower() + what[1:], path, text, file)


def _unit(path: Path) -> str:
    """The unit of the field at `path`, in brackets, if it has one."""
    return next((f" ({UNITS[step]})" for step in path[::-1] if step in UNITS), "")


def _value_path(path: str) -> Path:
    """`.object[2].mass` as keys and indexes."""
    return tuple(key or int(index) for key, index in _STEP.findall(path))


def _value(path: Path, data: Any) -> Any:
    """The value at `path`, which exists."""
    for step in path:
        data = data[step]
    return data


def _struct(path: Path, data: dict[str, Any]) -> type[msgspec.Struct]:
    """The struct that describes the table at `path`."""
    if not path:
        return Scenario
    section = str(path[0])
    if section in _TAGGED:
        tag, kinds = _TAGGED[section]
        kind: type[msgspec.Struct] = kinds[_value(path[:2], data)[tag]]
        return kind
    return _SECTIONS[section]


def _fields(path: Path, data: dict[str, Any]) -> list[str]:
    """Names of the fields that the table at `path` may have."""
    tags = [_TAGGED[str(path[0])][0]] if path and path[0] in _TAGGED else []
    return tags + [field.encode_name for field in msgspec.structs.fields(_struct(path, data))]


def _choices(path: Path, data: dict[str, Any]) -> list[str]:
    """The values that the field at `path` may have."""
    *table, name = path
    if table and table[0] in _TAGGED and name == _TAGGED[str(table[0])][0]:
        return list(_TAGGED[str(table[0])][1])
    kind = next(f.type for f in msgspec.structs.fields(_struct(tuple(table), data)) if f.encode_name == name)
    return _literals(kind)


def _literals(kind: Any) -> list[str]:
    """All strings of the `Literal`s in a type."""
    if get_origin(kind) is Literal:
        return [str(value) for value in get_args(kind)]
    return [value for part in get_args(kind) for value in _literals(part)]
