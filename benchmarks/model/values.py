"""Reads values of TLA+ as the checker prints them: numbers, strings, sets, sequences, records and functions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

_TOKEN = re.compile(r'\s*(<<|>>|\|->|:>|@@|/\\|[{}\[\](),=]|"[^"]*"|-?\d+|\w+)')
_STATE = re.compile(r"^(?:State \d+: <|STATE_\d+ == *\n)", re.MULTILINE)


class _Reader:
    """Walks the tokens of one value."""

    def __init__(self, text: str) -> None:
        self._tokens = [match[1] for match in _TOKEN.finditer(text)]
        self._at = 0

    @property
    def next(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def take(self, expected: str | None = None) -> str:
        token = self.next
        if not token or (expected is not None and token != expected):
            raise ValueError(f"{expected or 'a value'} expected instead of {token or 'the end'}")
        self._at += 1
        return token

    def value(self) -> Any:
        token = self.take()
        match token:
            case "{":
                return list(self._until("}"))
            case "<<":
                return list(self._until(">>"))
            case "[":
                return self._record()
            case "(":
                return self._function()
            case "TRUE" | "FALSE":
                return token == "TRUE"
        return token[1:-1] if token.startswith('"') else int(token)

    def _until(self, end: str) -> Iterator[Any]:
        while self.next != end:
            yield self.value()
            if self.next != end:
                self.take(",")
        self.take(end)

    def _record(self) -> dict[str, Any]:
        record: dict[str, Any] = {}
        while self.next != "]":
            name = self.take()
            self.take("|->")
            record[name] = self.value()
            if self.next != "]":
                self.take(",")
        self.take("]")
        return record

    def _function(self) -> list[tuple[Any, Any]]:
        pairs = []
        while self.next != ")":
            argument = self.value()
            self.take(":>")
            pairs.append((argument, self.value()))
            if self.next != ")":
                self.take("@@")
        self.take(")")
        return pairs

    def variables(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while self.next == "/\\":
            self.take()
            name = self.take()
            self.take("=")
            found[name] = self.value()
        return found


def value_of(text: str) -> Any:
    """Read one value. Sets and sequences are lists, records are dicts, functions are lists of pairs.

    Raises `ValueError`.
    """
    return _Reader(text).value()


def states_of(text: str) -> list[dict[str, Any]]:
    """Read all states that a checker has printed, or written to a file: the variables of each by name."""
    starts = [match.end() for match in _STATE.finditer(text)]
    return [_Reader(text[text.index("/\\", start) :]).variables() for start in starts]


def text_of(value: Any) -> str:
    """Write a number, a string, or lists of these as sequences, as TLA+."""
    if isinstance(value, list):
        return f"<<{', '.join(map(text_of, value))}>>"
    return f'"{value}"' if isinstance(value, str) else str(value)
