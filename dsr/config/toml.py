"""Configuration: plain data and TOML files checked against a msgspec Struct; errors name file, line and field."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import msgspec

from dsr.config.toml_lines import Path as ValuePath
from dsr.config.toml_lines import line_of, parse_toml
from dsr.errors import ConfigError, suggest
from dsr.files.data_files import read_text

T = TypeVar("T")

_STEP = re.compile(r"\.?([\w-]+)|\[(\d+)\]")
_AT_LINE = re.compile(r" \(at line (\d+).*| \(at end of document\)")


class MisfitError(ConfigError):
    """A value that does not fit its field; `path` says where it stands."""

    def __init__(self, message: str, path: ValuePath) -> None:
        super().__init__(message)
        self.path = path


class TomlFile:
    """A parsed TOML file that knows on which line each value stands. Raises `ConfigError` if it is none."""

    def __init__(self, file: Path) -> None:
        self._file = str(file)
        self._text = read_text(file)
        try:
            self.data: dict[str, Any] = parse_toml(self._text)
        except tomllib.TOMLDecodeError as error:
            found = _AT_LINE.search(str(error))
            line = int(found[1]) if found and found[1] else len(self._text.splitlines()) or None
            message = _AT_LINE.sub("", str(error))
            raise ConfigError(f"not valid TOML: {message}", file=self._file, line=line) from error
        except RecursionError as error:
            raise ConfigError("not valid TOML: nested too deeply", file=self._file) from error

    def convert(self, kind: type[T], path: ValuePath = ()) -> T:
        """The value at `path` as a `kind`, unknown fields refused. Raises `ConfigError` with its line."""
        data: Any = self.data
        for step in path:
            data = data[step]
        try:
            return convert(data, kind)
        except MisfitError as error:
            raise self.error(str(error), (*path, *error.path)) from error

    def error(self, message: str, path: ValuePath = ()) -> ConfigError:
        """`message` with the file and the line of the value at `path` in front."""
        return ConfigError(message, file=self._file, line=line_of(self._text, path))


def convert(data: Any, kind: type[T], what: str = "") -> T:
    """`data` as a `kind`, unknown fields refused. Raises `MisfitError`, with `what` in front of the message."""
    prefix = f"{what}: " if what else ""
    _refuse_unknown(data, kind, (), prefix)
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at `$")
        path = tuple(int(index) if index else name for name, index in _STEP.findall(place))
        where = f"{_dotted(path)}: " if path else ""
        raise MisfitError(f"{prefix}{where}{message[:1].lower()}{message[1:]}", path) from error


def _refuse_unknown(data: Any, kind: Any, path: ValuePath, prefix: str) -> None:
    """Raise for the first key of a (nested) Struct that is no field, with the closest valid name."""
    struct = _struct_in(kind)
    if isinstance(data, list):
        for index, item in enumerate(data):
            _refuse_unknown(item, kind, (*path, index), prefix)
    elif get_origin(kind) is dict and isinstance(data, Mapping):
        for key, value in data.items():
            _refuse_unknown(value, get_args(kind)[1], (*path, key), prefix)
    elif struct is not None and isinstance(data, Mapping):
        fields = _fields(struct)
        for key, value in data.items():
            if key not in fields:
                where = f" in {_dotted(path)}" if path else ""
                raise MisfitError(f"{prefix}unknown field {key!r}{where}; {suggest(key, fields)}", (*path, key))
            _refuse_unknown(value, fields[key], (*path, key), prefix)


@cache
def _fields(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """The types of the fields of a Struct."""
    return {field.encode_name: field.type for field in msgspec.structs.fields(struct)}


def _struct_in(kind: Any) -> type[msgspec.Struct] | None:
    """The only Struct inside an annotation such as `tuple[Object, ...]` or `Camera | None`."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind
    inside = [struct for argument in get_args(kind) if (struct := _struct_in(argument)) is not None]
    return inside[0] if len(inside) == 1 else None


def _dotted(path: ValuePath) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")
