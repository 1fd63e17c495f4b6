"""Reading files that may come from anywhere: regular ones up to a size; every refusal is a `ConfigError`."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from dsr.errors import ConfigError

TEXT_BYTES = 1 << 22
"""Most bytes of a file that people write by hand, such as a system or a scenario: 30 times the longest one here."""


def read_file(file: Path, most_bytes: int) -> bytes:
    """The content of a regular file of at most `most_bytes` bytes.

    Raises `ConfigError`, which names the file, for one that is missing, unreadable, larger, a folder, device or pipe.
    """
    name = str(file)
    try:
        # Without O_NONBLOCK, opening a pipe that nobody writes would wait for ever.
        with open(file, "rb", opener=lambda path, flags: os.open(path, flags | os.O_NONBLOCK)) as opened:
            if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
                raise ConfigError("cannot be read: it is a device or a pipe", file=name)
            size = os.fstat(opened.fileno()).st_size
            data = opened.read(most_bytes + 1) if size <= most_bytes else b""
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror}", file=name) from error
    if max(size, len(data)) > most_bytes:
        raise ConfigError(f"has {max(size, len(data))} bytes; at most {most_bytes} are read", file=name)
    return data


def read_text(file: Path, most_bytes: int = TEXT_BYTES) -> str:
    """The text in a file in UTF-8, with or without a byte order mark. Raises `ConfigError` like `read_file`."""
    try:
        return read_file(file, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = f"byte {error.start} is {error.object[error.start]:#04x}"
        raise ConfigError(f"is no UTF-8 text ({what})", file=str(file)) from error
