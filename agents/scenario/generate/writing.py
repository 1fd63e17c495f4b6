"""Writes a scenario as the text of a scenario file, without what is as it is by default."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from agents.scenario.format.scenario import Scenario

_FROM_SHAPE = "size"
"""The field of an object that follows from its `shape`."""


def to_toml(scenario: Scenario, heading: str) -> str:
    """The file of a scenario, which begins with the comment `heading`; `parse_scenario` reads it."""
    plain = _plain(scenario)
    for table in plain.get("object", []):
        if "shape" in table:
            table.pop(_FROM_SHAPE, None)
    values = {key: value for key, value in plain.items() if not _is_table(value)}
    blocks = [f"# {heading}", _lines(values)]
    for key, value in plain.items():
        for table in _tables(value):
            name = f"[[{key}]]" if isinstance(value, list) else f"[{key}]"
            blocks.append(f"{name}\n{_lines(table)}")
    return "\n\n".join(blocks) + "\n"


def _plain(struct: msgspec.Struct) -> dict[str, Any]:
    """A struct as plain values by their names in a file, with its tag, and without fields that have their default."""
    config = struct.__struct_config__
    found: dict[str, Any] = {config.tag_field: config.tag} if config.tag_field else {}
    for field in msgspec.structs.fields(struct):
        value = getattr(struct, field.name)
        default = field.default_factory() if callable(field.default_factory) else field.default
        if value == default:
            continue
        if isinstance(value, msgspec.Struct):
            found[field.encode_name] = _plain(value)
        elif isinstance(value, list) and isinstance(value[0], msgspec.Struct):
            found[field.encode_name] = [_plain(item) for item in value]
        elif field.name == "shape":
            found[field.encode_name] = [[part.kind, part.size, part.position, part.rotation] for part in value]
        else:
            found[field.encode_name] = value
    return found


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _tables(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
    elif _is_table(value):
        yield from value


def _lines(table: dict[str, Any]) -> str:
    """One line for each value."""
    return "\n".join(f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: Any) -> str:
    """Strings, numbers, truth values and arrays are written in TOML as in JSON."""
    return msgspec.json.format(msgspec.json.encode(value), indent=0).decode()
