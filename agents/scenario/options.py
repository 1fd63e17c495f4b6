"""Options that several commands about scenarios have in common."""

from __future__ import annotations

import enum


class SensorChoice(enum.StrEnum):
    """Values of `--sensor`."""

    PIXELS = "pixels"
    POSES = "poses"
