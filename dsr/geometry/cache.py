"""Meshes in the user's cache folder: files named by hash, checked when read; the least used are forgotten."""

from __future__ import annotations

import contextlib
import logging
import os
from pathlib import Path

from dsr.files.private_files import private_folder, replacing
from dsr.geometry.mesh import MOST_BYTES, hash_of

DISK_LIMIT = 2 << 30
"""bytes of all files together"""
_SUFFIX = ".mesh"
_log = logging.getLogger("dsr.meshes")


def cache_folder() -> Path:
    """The folder in which this user's processes share meshes: `$XDG_CACHE_HOME/dsr/meshes`, else below `~/.cache`."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "dsr" / "meshes"


class DiskCache:
    """A bounded folder of canonical bytes. A disk that cannot be read or written is said once, and done without.

    Args:
        folder: made when first written to.
        limit: bytes of all files together.
    """

    def __init__(self, folder: Path, limit: int = DISK_LIMIT) -> None:
        self.folder = folder
        self.limit = limit
        self.mismatched = 0
        """Files that did not hold what their name says, and were removed."""
        self._complained = False

    def read(self, hash: str) -> bytes | None:
        """The bytes with this hash, if they are here."""
        file = self._file(hash)
        try:
            if file.stat().st_size > MOST_BYTES:
                return None
            data = file.read_bytes()
            os.utime(file)
        except FileNotFoundError:
            return None
        except OSError as error:
            self._complain(error)
            return None
        if hash_of(data) == hash:
            return data
        self.mismatched += 1
        _log.warning("%s does not hold what its name says; removed", file)
        self.forget(hash)
        return None

    def write(self, hash: str, data: bytes | memoryview) -> None:
        """Keep bytes, unless they are here already or larger than the whole cache may be."""
        file = self._file(hash)
        if len(data) > self.limit or file.exists():
            return
        try:
            private_folder(self.folder)
            self._make_room(len(data))
            with replacing(file) as new:
                new.write(data)
        except OSError as error:
            self._complain(error)

    def forget(self, hash: str) -> None:
        """Remove a file; harmless if there is none."""
        with contextlib.suppress(OSError):
            self._file(hash).unlink(missing_ok=True)

    def _file(self, hash: str) -> Path:
        return self.folder / f"{hash}{_SUFFIX}"

    def _make_room(self, size: int) -> None:
        """Remove what was used least lately, and what a process left that died while it wrote."""
        found = []
        for file in self.folder.iterdir():
            with contextlib.suppress(FileNotFoundError):  # another process makes room too
                status = file.stat()
                found.append((status.st_mtime, status.st_size, file))
        total = sum(length for _, length, _ in found) + size
        for _, length, file in sorted(found):
            if total <= self.limit:
                break
            file.unlink(missing_ok=True)
            total -= length

    def _complain(self, error: OSError) -> None:
        if not self._complained:
            self._complained = True
            _log.warning("meshes are not cached on disk: %s", error)
