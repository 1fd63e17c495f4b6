"""The model's file, `hand_landmarker.task`, a zip archive of two networks: where it is, and whether it is whole."""

from __future__ import annotations

import hashlib
import lzma
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from agents.hand_tracker.model.found import FAILURES
from dsr.errors import ConfigError
from dsr.files.private_files import private_folder, replacing

DETECTOR, LANDMARKER = "hand_detector.tflite", "hand_landmarks_detector.tflite"
"""Entries of the archive: the network that finds palms, and the one that finds the landmarks of a hand."""
VERSION = "0.10.21"
"""Of the package mediapipe, the newest whose wheel carries the two networks."""
SHA256 = {
    DETECTOR: "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    LANDMARKER: "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
}
"""Of the networks in that wheel, the same on every platform."""
HOW_TO_GET = "`dsr hands fetch` gets it (docs/how-to/hands.md)"
UNREADABLE = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, *FAILURES)
"""Exceptions of an archive that is none, or is damaged."""
MOST_BYTES = 64 << 20
"""Of a network: that of the model has 5 MB"""
_NAME = "hand_landmarker.task"


class ModelFiles(NamedTuple):
    """The two networks of a model."""

    where: str
    """The file, for messages."""
    contents: Mapping[str, bytes]
    """TensorFlow Lite models by the name of the entry."""


def fetched_file() -> Path:
    """Where `dsr hands fetch` puts the model: `$XDG_CACHE_HOME/dsr/hands/VERSION`, else below `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "dsr" / "hands" / VERSION / _NAME


def read_model(file: Path) -> ModelFiles:
    """The networks in a model's file, whoever made it. Raises `ConfigError` if it cannot be one."""
    name = str(file)
    try:
        size = file.stat().st_size if file.is_file() else None
    except (OSError, ValueError) as error:
        raise ConfigError(f"model file {name!r} cannot be read ({error}); {HOW_TO_GET}") from error
    if size is None:
        raise ConfigError(f"no model file {name!r}; {HOW_TO_GET}")
    if size == 0:
        raise ConfigError(f"model file {name!r} is empty; {HOW_TO_GET}")
    try:
        with zipfile.ZipFile(file) as archive:
            entries = {entry.filename: entry.file_size for entry in archive.infolist()}
            missing = [entry for entry in SHA256 if entry not in entries]
            large = [entry for entry in SHA256 if entries.get(entry, 0) > MOST_BYTES]
            contents = {} if missing or large else {entry: archive.read(entry) for entry in SHA256}
    except UNREADABLE as error:
        raise ConfigError(f"model file {name!r} is corrupt ({error}); {HOW_TO_GET}") from error
    if missing or large:
        wrong = f"lacks {', '.join(missing)}" if missing else f"is too large at {', '.join(large)}"
        raise ConfigError(f"model file {name!r} {wrong}; {HOW_TO_GET}")
    return ModelFiles(name, contents)


def read_fetched() -> ModelFiles:
    """The fetched model. Raises `ConfigError` if it is not there, or not what was fetched."""
    model = read_model(fetched_file())
    check_contents(model.contents, model.where)
    return model


def check_contents(contents: Mapping[str, bytes], where: str) -> None:
    """Raise `ConfigError` unless the networks are those of mediapipe `VERSION`, byte by byte."""
    for entry, expected in SHA256.items():
        found = hashlib.sha256(contents[entry]).hexdigest()
        if found != expected:
            raise ConfigError(f"{where}: {entry} has the wrong checksum {found}, expected {expected}; {HOW_TO_GET}")


def write_model(contents: Mapping[str, bytes], file: Path) -> None:
    """Put the networks into a model's file, in one step or not at all.

    They are stored as they are: MediaPipe does not unpack. Raises `OSError`.
    """
    if file == fetched_file():
        private_folder(file.parent)
    else:
        file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as new, zipfile.ZipFile(new, "w", zipfile.ZIP_STORED) as archive:
        for entry in SHA256:
            archive.writestr(zipfile.ZipInfo(entry), contents[entry])
