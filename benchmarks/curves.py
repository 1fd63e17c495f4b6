"""Writes the curves of the plots as CSV: a line for each point, a column for each of those that were measured."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_AXES = {"cascade": ("graphs", "ms"), "world cascade": ("worlds", "ms"), "growth": ("nodes", "us")}
"""What the points are told apart by, and the unit of what was measured."""


def write(curves: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write a file beside the PNG of each plot that has curves over an axis; the files."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        _written(curves[name], axis, unit, file_for(name, folder, "csv"))
        for name, (axis, unit) in _AXES.items()
        if name in curves
    ]


def file_for(name: str, folder: Path, kind: str) -> Path:
    """The file of a plot's picture or figures."""
    return folder / f"{name.replace(' ', '_')}.{kind}"


def _written(curve: Mapping[str, Any], axis: str, unit: str, file: Path) -> Path:
    columns = curve[unit]
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([axis, *(f"{name} ({unit})" for name in columns)])
        writer.writerows(zip(curve[axis], *columns.values(), strict=True))
    return file
