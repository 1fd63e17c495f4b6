"""Where a value stands in a TOML text, so that an error can name the line."""

from __future__ import annotations

import re
import tomllib
from typing import Any

Path = tuple[str | int, ...]
"""Keys and indexes from the root, e.g. `("object", 2, "mass")`."""

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|[\[\]{}\n]', re.DOTALL
)


_MOST_PARTS = 32
"""Of a dotted key; no file here has more than four. The parser takes the square of their number in time."""
_PART = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"{_PART}(?:\.[ \t]*+{_PART}){{{_MOST_PARTS}}}")
_LONG_NUMBER = re.compile(r"[0-9a-fA-FxX_]{1000}")


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises `TOMLDecodeError`, also for keys of very many parts and endless numbers, and `RecursionError`.
    """
    if found := _LONG_KEY.search(text):
        raise tomllib.TOMLDecodeError(f"a key of more than {_MOST_PARTS} parts{_at(text, found)}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise tomllib.TOMLDecodeError(f"a number is too long{_at(text, _LONG_NUMBER.search(text))}") from error


def _at(text: str, found: re.Match[str] | None) -> str:
    """A place as the parser itself tells it."""
    return f" (at line {text.count(chr(10), 0, found.start()) + 1}, column 1)" if found else ""


def line_of(text: str, path: Path) -> int | None:
    """The line (from 1) of the value at `path`, or of the closest table around it; None if nothing fits."""
    places = value_lines(text)
    for length in range(len(path), 0, -1):
        if path[:length] in places:
            return places[path[:length]]
    return None


def value_lines(text: str) -> dict[Path, int]:
    """Line of each table header and key of a valid TOML text; inline tables count as one value."""
    continued = _continuation_lines(text)
    table: Path = ()
    counts: dict[Path, int] = {}
    places: dict[Path, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if number in continued:
            continue
        if line.lstrip().startswith("["):
            table = _table_path(line, counts)
            for length in range(1, len(table) + 1):
                places.setdefault(table[:length], number)
        elif key := _key_path(line):
            for length in range(1, len(key) + 1):
                places.setdefault(table + key[:length], number)
    return places


def _continuation_lines(text: str) -> set[int]:
    """Lines on which a value that began above goes on."""
    line, depth, continued = 1, 0, set()
    for token in _TOKEN.findall(text):
        if token == "\n":
            line += 1
            if depth:
                continued.add(line)
        elif token in "[{":
            depth += 1
        elif token in "]}":
            depth -= 1
        else:
            continued.update(range(line + 1, line + token.count("\n") + 1))
            line += token.count("\n")
    return continued


def _table_path(header: str, counts: dict[Path, int]) -> Path:
    """Path of `[a.b]` or `[[a]]`; `counts` holds the number of elements of each array so far."""
    parsed = tomllib.loads(header)
    path: Path = ()
    while parsed:
        (key, value), *_ = parsed.items()
        path += (key,)
        if isinstance(value, list):
            counts[path] = counts.get(path, 0) + 1
            value = value[0]
        if path in counts:
            path += (counts[path] - 1,)
        parsed = value
    return path


def _key_path(line: str) -> Path:
    """Path of the key of `a.b = ...`; empty for other lines."""
    key, equals, _ = line.partition("=")
    if not equals or key.lstrip().startswith("#"):
        return ()
    try:
        parsed: Any = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError:
        return ()
    path: Path = ()
    while isinstance(parsed, dict):
        (name, parsed), *_ = parsed.items()
        path += (name,)
    return path
