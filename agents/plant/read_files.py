"""A folder for files that the physics engine reads, at one place as long as this process runs.

pybullet and its renderer keep meshes and textures for good, by the names of their files. So equal contents need equal
names, and others need other ones.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

_DIGITS = 16  # of 64 bits: two contents of one name would take 4e9 files
_taken = threading.Lock()


@contextlib.contextmanager
def folder_to_read() -> Iterator[Path]:
    """The folder, empty; it goes at the end."""
    with _taken:
        folder = _place(os.getpid())
        folder.mkdir(mode=0o700)
        try:
            yield folder
        finally:
            shutil.rmtree(folder)


def name_by_content(name: str, *contents: bytes) -> str:
    """A file name without suffix that begins with `name`, and is another one for other contents."""
    return f"{name}-{hashlib.sha256(b'|'.join(contents)).hexdigest()[:_DIGITS]}"


@functools.cache
def _place(process: int) -> Path:
    """A name that nobody else has, of a process of this number: a fork has a place of its own."""
    folder = Path(tempfile.mkdtemp(prefix=f"dsr-plant-{process}-"))
    folder.rmdir()
    return folder
