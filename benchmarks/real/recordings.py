"""What every benchmark on recordings of others has: a name, where the recordings come from, and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from dsr.math3d.transforms import Array


class DataError(Exception):
    """A folder does not hold the recordings that a benchmark needs."""


class Outcome(NamedTuple):
    """What a benchmark found."""

    table: Table
    remarks: list[str]
    """Sentences that the table needs to be understood."""
    figures: dict[str, Any]
    """For JSON."""


class RealBenchmark(NamedTuple):
    """A benchmark on recordings of others."""

    name: str
    """Of the command."""
    what: str
    """What it measures; the first line by itself says it in short."""
    published: str
    """Where the recordings are published, and under which licence."""
    run: Callable[[Path], Outcome]
    """Measure, given the folder with the recordings. Raises `DataError` if something is missing."""
    draw: Callable[[Path], Iterator[tuple[str, NDArray[np.uint8]]]] | None = None
    """Draw what is found into the images: names of the pictures, and (h, w, 3), blue first; None without images."""


def needed(folder: Path, *names: str) -> list[Path]:
    """Paths in a folder. Raises `DataError` that names the first one that does not exist."""
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder")
    paths = [folder / name for name in names]
    for path in paths:
        if not path.exists():
            raise DataError(f"{path} does not exist")
    return paths


def quantiles(values: Sequence[float] | Array, *shares: float) -> list[float]:
    """Quantiles of values, nan without any."""
    found = np.asarray(values, dtype=np.float64)
    return [float(np.quantile(found, share)) if len(found) else float("nan") for share in shares]
