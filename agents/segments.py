"""Numbered files of one recording: `recording.mcap`, and `recording-2.mcap` after its writer was restarted."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from pathlib import Path

from dsr.files.private_files import FOLDER_MODE

KEPT_PARTS = 8
"""Files in which a recording of a limited size is kept, if nothing is said: removing one leaves most of it."""


def segments(folder: Path, name: str) -> list[Path]:
    """The files of recording `name` (such as `recording.mcap`) in `folder`, in the order they were written."""
    return [file for _, file in sorted(_numbered(folder, name).items())]


def next_segment(folder: Path, name: str) -> Path:
    """Where a writer that starts now should write; makes `folder` if missing, never names a file that exists."""
    folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
    number = max(_numbered(folder, name), default=0) + 1
    stem, suffix = Path(name).stem, Path(name).suffix
    return folder / (name if number == 1 else f"{stem}-{number}{suffix}")


def total_size(files: Iterable[Path]) -> int:
    """Bytes that these files take together; one that is gone takes none."""
    total = 0
    for file in files:
        with contextlib.suppress(OSError):
            total += file.stat().st_size
    return total


def _numbered(folder: Path, name: str) -> dict[int, Path]:
    stem, suffix = re.escape(Path(name).stem), re.escape(Path(name).suffix)
    pattern = re.compile(rf"{stem}(?:-([2-9]|[1-9]\d+))?{suffix}")
    found = ((pattern.fullmatch(file.name), file) for file in folder.iterdir()) if folder.is_dir() else ()
    return {int(match[1] or 1): file for match, file in found if match}
