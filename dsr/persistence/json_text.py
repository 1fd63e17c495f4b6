"""JSON files as people edit them: errors that name file, line, column and path; short values on one line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dsr.errors import ConfigError
from dsr.files.data_files import read_text
from dsr.graph.schema import is_text

ValuePath = tuple[str | int, ...]
"""Keys and indexes from the root, e.g. `("nodes", 2, "name")`."""
Problem = tuple[ValuePath, str]
"""The place of a fault in a document, and its description."""

MAX_BYTES = 1 << 28
"""Larger files are refused: a graph of 100 000 nodes takes a tenth of that."""
MAX_DEPTH = 100
"""Lists and objects inside each other, at most."""
MOST_VALUES = 1 << 25
"""Values in a file, at most: each takes about 64 bytes in memory, however short its text is."""
_MOST_PROBLEMS = 20
_WIDTH = 110
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+')
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
_PLAIN_KEY = re.compile(r"[A-Za-z_]\w*")


class JsonFile:
    """A parsed JSON file that knows where each value stands. Raises `ConfigError` if it is none."""

    def __init__(self, file: Path) -> None:
        self._file = str(file)
        self._text = _read(file)
        duplicates: list[str] = []

        def to_dict(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
            members = dict(pairs)
            if len(members) < len(pairs):
                duplicates.extend(key for key, _ in pairs)
            return members

        try:
            self.data: Any = json.loads(self._text, object_pairs_hook=to_dict)
        except json.JSONDecodeError as error:
            raise ConfigError(f"{self._file}:{error.lineno}:{error.colno}: not valid JSON: {error.msg}") from error
        except RecursionError as error:
            raise ConfigError("nested too deeply", file=self._file) from error
        except ValueError as error:
            raise ConfigError("not valid JSON: an integer of thousands of digits", file=self._file) from error
        if _is_deeper(self.data, MAX_DEPTH):
            raise ConfigError("nested too deeply", file=self._file)
        if duplicates:
            raise self.error(self._repeated())
        if _SURROGATE.search(self._text) and (problems := self._unpaired()):
            raise self.error(problems)

    def error(self, problems: list[Problem]) -> ConfigError:
        """The first 20 problems in the order of the file, each on a line with its place in front."""
        told = problems[:_MOST_PROBLEMS]
        offsets = self._offsets({path for path, _ in told})
        located = sorted((_offset(offsets, path), path, message) for path, message in told)
        lines = [self._line(offset, path, message) for offset, path, message in located]
        if len(problems) > _MOST_PROBLEMS:
            lines.append(f"{self._file}: and more; this file was read no further")
        return ConfigError("\n".join(lines))

    def _offsets(self, wanted: set[ValuePath]) -> dict[ValuePath, int]:
        """Where the values at these paths, and those around them, begin; what is behind the last is not looked at."""
        around = {path[:length] for path in wanted for length in range(len(path) + 1)}
        missing, offsets = set(wanted), dict[ValuePath, int]()
        for path, offset in _places(self._text):
            if path in around:
                offsets.setdefault(path, offset)
                missing.discard(path)
                if not missing:
                    break
        return offsets

    def _line(self, offset: int, path: ValuePath, message: str) -> str:
        line = self._text.count("\n", 0, offset) + 1
        column = offset - self._text.rfind("\n", 0, offset)
        where = f"{dotted(path)}: " if path else ""
        return f"{self._file}:{line}:{column}: {where}{message}"

    def _repeated(self) -> list[Problem]:
        seen: set[ValuePath] = set()
        problems: list[Problem] = []
        for path, _ in _places(self._text):
            if path in seen:
                problems.append((path, "stands here twice"))
            seen.add(path)
        return problems[:1]

    def _unpaired(self) -> list[Problem]:
        """Names and texts with half of a character, which no UTF-8 can hold."""
        strings = [(path, step) for path, _ in _places(self._text) for step in path[-1:] if isinstance(step, str)]
        for path, offset in _places(self._text):
            token = _TOKEN.match(self._text, offset)
            if token and token[0].startswith('"'):
                strings.append((path, json.loads(token[0])))
        return [(path, f"{text!r:.80} holds half of a surrogate pair") for path, text in strings if not is_text(text)]


class Problems:
    """Collects the faults of a file; with more faults than are told, reading ends at once."""

    def __init__(self, file: JsonFile) -> None:
        self._file = file
        self._found: list[Problem] = []

    def add(self, path: ValuePath, message: str) -> None:
        """Note a problem at `path`. Raises `ConfigError` if there are too many."""
        self._found.append((path, message))
        if len(self._found) > _MOST_PROBLEMS:
            self.tell()

    def tell(self) -> None:
        """Raise `ConfigError` if anything is wrong."""
        if self._found:
            raise self._file.error(self._found)


def _read(file: Path) -> str:
    text = read_text(file, MAX_BYTES)
    values = text.count(",") + text.count("[") + text.count("{")
    if values > MOST_VALUES:
        raise ConfigError(f"has up to {values} values; at most {MOST_VALUES} are read", file=str(file))
    return text


def _is_deeper(value: Any, levels: int) -> bool:
    if not isinstance(value, dict | list):
        return False
    items = value.values() if isinstance(value, dict) else value
    return not levels or any(_is_deeper(item, levels - 1) for item in items)


def dotted(path: ValuePath) -> str:
    """A path as people write it: `nodes[2].name`."""
    return "".join(_step(step) for step in path).lstrip(".")


def _step(step: str | int) -> str:
    if isinstance(step, int):
        return f"[{step}]"
    return f".{step}" if _PLAIN_KEY.fullmatch(step) else f"[{json.dumps(step)}]"


def _offset(offsets: dict[ValuePath, int], path: ValuePath) -> int:
    """Where the value at `path` begins, or the closest one around it."""
    return next(offsets[path[:length]] for length in range(len(path), -1, -1) if path[:length] in offsets)


def _places(text: str) -> Iterator[tuple[ValuePath, int]]:
    """Path and offset of every value of a valid JSON text, in its order."""
    tokens = _TOKEN.finditer(text)
    return _walk(tokens, next(tokens), ())


def _walk(tokens: Iterator[re.Match[str]], first: re.Match[str], path: ValuePath) -> Iterator[tuple[ValuePath, int]]:
    yield path, first.start()
    if first[0] == "{":
        for key in tokens:
            if key[0] == "}":
                return
            if key[0] != ",":
                next(tokens)  # the colon
                yield from _walk(tokens, next(tokens), (*path, json.loads(key[0])))
    elif first[0] == "[":
        index = 0
        for token in tokens:
            if token[0] == "]":
                return
            if token[0] != ",":
                yield from _walk(tokens, token, (*path, index))
                index += 1


def to_text(value: Any) -> str:
    """Indented JSON in which what fits is on one line; floats are exact. Raises `ValueError` for one not finite."""
    return _indented(value, 0) + "\n"


def _indented(value: Any, depth: int) -> str:
    short = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if not isinstance(value, dict | list) or not value or len(short) + 2 * depth <= _WIDTH:
        return short
    inner, outer = "  " * (depth + 1), "  " * depth
    if isinstance(value, dict):
        items = [f"{json.dumps(key, ensure_ascii=False)}: {_indented(item, depth + 1)}" for key, item in value.items()]
        return "{\n" + ",\n".join(inner + item for item in items) + f"\n{outer}}}"
    return "[\n" + ",\n".join(inner + _indented(item, depth + 1) for item in value) + f"\n{outer}]"
