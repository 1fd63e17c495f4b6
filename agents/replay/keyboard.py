"""Single keys of a terminal, without waiting for a line; the terminal is put back as it was."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from types import TracebackType
from typing import Any

_SEQUENCES = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", "\x1b[H": "home", " ": "space"}
_MOST_BYTES = 1024


class Keyboard:
    """Keys pressed since the last look; none if the standard input is no terminal. A context manager."""

    def __init__(self) -> None:
        self.present = sys.stdin.isatty()
        self._before: list[Any] = []

    def __enter__(self) -> Keyboard:
        if self.present:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.present:
            with contextlib.suppress(termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def pressed(self) -> list[str]:
        """Names of the keys: `space`, `left`, `right`, `up`, `down`, `home`, or a character."""
        if not self.present or not select.select([sys.stdin], [], [], 0.0)[0]:
            return []
        data = os.read(sys.stdin.fileno(), _MOST_BYTES)
        self.present = bool(data)  # no more will come at the end of the input
        return list(split_keys(data.decode(errors="ignore")))


def split_keys(text: str) -> Iterator[str]:
    """The names of the keys that a terminal sent as `text`."""
    while text:
        known = next((sequence for sequence in _SEQUENCES if text.startswith(sequence)), text[0])
        yield _SEQUENCES.get(known, known)
        text = text[len(known) :]
