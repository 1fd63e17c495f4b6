"""What a fuzzed decoder or key did with the messages it got."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

_MOST_EXAMPLES = 3
_PROCESS = psutil.Process()
MAX_GROWTH = 300 * 1024 * 1024
"""Bytes by which the process may grow; what a message may hold for a moment included."""


@dataclass
class Tally:
    """Counts of one target."""

    name: str
    messages: int = 0
    refused: int = 0
    accepted: int = 0
    exceptions: int = 0
    """That were none of the project's errors, or made no sense."""
    changes: int = 0
    """Of state, by a refused message."""
    miscounted: int = 0
    """Refused messages that `dropped` does not tell, or that were logged again and again."""
    growth: int = 0
    """Bytes, the most that the process grew."""
    examples: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether nothing went wrong."""
        return not (self.exceptions or self.changes or self.miscounted) and self.growth < MAX_GROWTH

    def note(self, payload: bytes) -> None:
        """Keep an example of what went wrong, within an `except`."""
        if len(self.examples) < _MOST_EXAMPLES:
            self.examples.append(f"{payload[:200].hex()}: {traceback.format_exc(limit=-2)}")

    def expose(self, payload: bytes, decode: Callable[[bytes], Any], allowed: tuple[type[Exception], ...]) -> Any:
        """Decode a message and count what comes of it; what was decoded, or None."""
        self.messages += 1
        try:
            value = decode(payload)
        except allowed:
            self.refused += 1
            return None
        except Exception:
            self.exceptions += 1
            self.note(payload)
            return None
        self.accepted += 1
        return value


@contextmanager
def measured(tally: Tally) -> Iterator[Callable[[], None]]:
    """Notes how far the process grew at most, by the calls of what this gives."""
    before = resident()

    def look() -> None:
        tally.growth = max(tally.growth, resident() - before)

    yield look
    look()


def resident() -> int:
    """Bytes of memory that this process holds."""
    return int(_PROCESS.memory_info().rss)


def write_file(file: Path, payload: bytes) -> Path:
    """The file with this content."""
    file.write_bytes(payload)
    return file
