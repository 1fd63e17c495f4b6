"""Options that several commands about scenarios have in common."""

from __future__ import annotations

import enum
from pathlib import Path

from dsr.errors import ConfigError


class SensorChoice(enum.StrEnum):
    """Values of `--sensor`."""

    PIXELS = "pixels"
    POSES = "poses"


def check_writable(file: Path, option: str = "--json") -> None:
    """Raise `ConfigError` before a run rather than lose its result after it."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.open("a").close()
    except OSError as error:
        raise ConfigError(f"{option} {file}: cannot be written ({error.strerror})") from error
