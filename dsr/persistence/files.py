"""Graph files of either format: read by their content, written so that a failure leaves the old file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from dsr.errors import ConfigError
from dsr.files.private_files import replacing
from dsr.persistence.content import GraphContent
from dsr.persistence.cortex import from_cortex
from dsr.persistence.cortex_export import to_cortex
from dsr.persistence.document import from_document, to_document
from dsr.persistence.json_text import JsonFile

FileFormat = Literal["dsr", "cortex"]
_READABLE = 0o666
"""Permissions of a file that the user asked for, less the umask."""
_WRITERS: dict[FileFormat, Callable[[GraphContent], str]] = {"dsr": to_document, "cortex": to_cortex}


def read_graph(file: str | Path) -> GraphContent:
    """The graph in a file of this project or of CORTEX. Raises `ConfigError` that names each problem's place."""
    source = JsonFile(Path(file))
    if isinstance(source.data, dict):
        if "DSRModel" in source.data:
            return from_cortex(source)
        if "format" in source.data:
            return from_document(source)
    raise source.error([((), 'expected a graph: an object with "format": "dsr-graph", or with "DSRModel"')])


def write_graph(content: GraphContent, file: str | Path, file_format: FileFormat = "dsr") -> None:
    """Write a graph file, where a link points to; equal graphs give equal files.

    Raises `ConfigError` if it cannot be written.
    """
    target = Path(file).resolve()
    if target.exists() and not target.is_file():
        raise ConfigError("cannot be written: is no regular file", file=str(file))
    try:
        text = _WRITERS[file_format](content)
    except RecursionError as error:
        raise ConfigError("cannot be written: a value is nested too deeply", file=str(file)) from error
    try:
        with replacing(target, _READABLE) as new:
            new.write(text.encode())
    except OSError as error:
        raise ConfigError(f"cannot be written: {error.strerror}", file=str(file)) from error
