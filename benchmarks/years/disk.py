"""Disks that fail: full, with errors, with writes that are torn or lost when the power goes.

The files are real ones in a folder, so that everything that reads them is the real thing. What writes them is watched
through the few calls by which `dsr.persistence` does so. A power cut leaves of each file what was flushed to the disk
(`fsync`) and any part of what was written later, damaged at the end if so it falls. Of names that were not flushed
with their folder, only the first few are left.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.years.lifeline import Lifeline
from dsr.files import private_files
from dsr.persistence import generations

_replace, _unlink, _fsync = os.replace, os.unlink, os.fsync
SECTOR = 512
"""bytes that a disk writes in one step; of a torn write the last sector may hold anything"""


@dataclass
class _Change:
    """A change of names that is not flushed yet, and how to take it back."""

    folder: Path
    undo: Callable[[], None]
    kept: Path | None = None
    """What has gone, until that is flushed."""


class FailingDisk:
    """The disk of one machine.

    Args:
        root: an empty folder, which becomes its content.
        seed: of what is left after a power cut.
    """

    def __init__(self, root: Path, seed: int) -> None:
        self.root = root
        self.met: Counter[str] = Counter()
        """Faults by kind."""
        self.full = False
        """Whether there is no room for a single byte more."""
        self.errors = 0.0
        """Probability with which a flush fails (EIO), and nothing of it is on the disk."""
        self.life: Lifeline | None = None
        """Of the process that runs there; none if none does."""
        self._random = np.random.default_rng(seed)
        self._trash = root.with_name(f"{root.name}.trash")
        self._removed = 0
        self._flushed: dict[int, int] = {}
        """Bytes that are on the disk, by inode; of those that were written since the last power cut."""
        self._changes: list[_Change] = []
        self._open: list[Any] = []
        root.mkdir()
        self._trash.mkdir()

    # ---- what the process does

    def reach(self, call: str) -> None:
        """Note a call of the process that runs there."""
        if self.life is not None:
            self.life.reach(call)

    def create(self, path: Path, opener: Callable[[str, int], int]) -> _File:
        """Make a file, open for writing."""
        self.reach("create")
        if self.full:
            self.met["no room"] += 1
            raise OSError(errno.ENOSPC, "the simulated disk is full", str(path))
        raw = open(path, "xb", buffering=0, opener=opener)  # noqa: SIM115 - it is handed on
        self._flushed[os.fstat(raw.fileno()).st_ino] = 0
        self._changes.append(_Change(path.parent, lambda: _gone(path)))
        file = _File(self, raw)
        self._open.append(file)
        return file

    def claim(self, path: Path, opener: Callable[[str, int], int]) -> Any:
        """Open the file that locks a folder."""
        self.reach("claim")
        opened = open(path, "a", encoding="utf-8", opener=opener)  # noqa: SIM115 - it is handed on
        self._open.append(opened)
        return opened

    def write(self, raw: Any, data: bytes) -> None:
        """Write at the end of a file; on a full disk a part of it."""
        self.reach("write")
        if self.full:
            self.met["no room"] += 1
            raw.write(data[: self._random.integers(len(data) + 1)])
            raise OSError(errno.ENOSPC, "the simulated disk is full")
        raw.write(data)

    def flush(self, descriptor: int) -> None:
        """Have the content of a file on the disk."""
        self.reach("fsync")
        status = os.fstat(descriptor)
        if self._random.random() < self.errors:
            self.met["input/output error"] += 1
            raise OSError(errno.EIO, "the simulated disk failed")
        if status.st_ino in self._flushed:
            self._flushed[status.st_ino] = status.st_size

    def flush_names(self, folder: Path) -> None:
        """Have the names in a folder on the disk."""
        self.reach("fsync of a folder")
        for change in self._changes:
            if change.folder == folder and change.kept is not None:
                _gone(change.kept)
        self._changes = [change for change in self._changes if change.folder != folder]

    def replace(self, source: Path, target: Path) -> None:
        """Give a file another name, in the place of what has that."""
        self.reach("replace")
        before = self._put_away(target) if target.exists() else None
        _replace(source, target)

        def undo() -> None:
            _back(target, source)
            if before is not None:
                _back(before, target)

        self._changes.append(_Change(target.parent, undo, before))

    def remove(self, path: Path) -> None:
        """Remove a name."""
        self.reach("unlink")
        kept = self._put_away(path)
        self._changes.append(_Change(path.parent, lambda: _back(kept, path), kept))

    def _put_away(self, path: Path) -> Path:
        self._removed += 1
        kept = self._trash / str(self._removed)
        _replace(path, kept)
        return kept

    # ---- what happens to it

    def let_go(self) -> None:
        """The process is dead: its files are closed, and what it had not handed over yet is gone."""
        for file in self._open:
            file.close_now() if isinstance(file, _File) else file.close()
        self._open, self.life = [], None

    def lose_power(self) -> None:
        """What was not flushed is lost, as a whole or in part."""
        kept = int(self._random.integers(len(self._changes) + 1))
        for change in reversed(self._changes[kept:]):
            self.met["lost name"] += 1
            change.undo()
        self._changes = []
        for path in [found for found in self.root.rglob("*") if found.is_file()]:
            status = path.stat()
            flushed = self._flushed.get(status.st_ino, status.st_size)
            if flushed < status.st_size:
                self._tear(path, flushed, status.st_size)
        self._flushed = {}
        shutil.rmtree(self._trash)
        self._trash.mkdir()

    def _tear(self, path: Path, flushed: int, size: int) -> None:
        """Keep what was flushed, and some of the rest; its last sector may hold anything."""
        kept = int(self._random.integers(flushed, size + 1))
        self.met["lost write" if kept == flushed else "torn write"] += 1
        data = bytearray(path.read_bytes()[:kept])
        begin = max(flushed, kept - kept % SECTOR)
        if begin < kept and self._random.random() < 0.5:
            data[begin:kept] = self._random.bytes(kept - begin)
        path.write_bytes(data)


class _File:
    """A file open for writing: what was written is handed to the disk by `flush`."""

    def __init__(self, disk: FailingDisk, raw: Any) -> None:
        self._disk = disk
        self._raw = raw
        self._buffer = bytearray()

    def write(self, data: bytes) -> int:
        self._buffer += data
        return len(data)

    def flush(self) -> None:
        if self._buffer:
            data, self._buffer = bytes(self._buffer), bytearray()
            self._disk.write(self._raw, data)

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def close(self) -> None:
        try:
            if not self._raw.closed:
                self.flush()
        finally:
            self._raw.close()

    def close_now(self) -> None:
        """Close without what was not flushed."""
        self._raw.close()

    def __enter__(self) -> _File:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


@contextlib.contextmanager
def failing_disks(disks: list[FailingDisk]) -> Iterator[None]:
    """While inside, everything that `dsr.persistence` writes goes to these disks, by the folder that it is in."""

    def of(path: Path | str) -> FailingDisk | None:
        return next((disk for disk in disks if Path(path).is_relative_to(disk.root)), None)

    def opened(path: Path, mode: str, *, opener: Callable[[str, int], int], encoding: str | None = None) -> Any:
        disk = of(path)
        if disk is None:
            return open(path, mode, encoding=encoding, opener=opener)
        return disk.claim(path, opener) if mode == "a" else disk.create(path, opener)

    def fsync(descriptor: int) -> None:
        disk = of(Path(f"/proc/self/fd/{descriptor}").readlink())
        disk.flush(descriptor) if disk else _fsync(descriptor)

    def sync_folder(folder: Path) -> None:
        disk = of(folder)
        assert disk is not None
        disk.flush_names(folder)

    def replace(source: Any, target: Any) -> None:
        disk = of(source)
        disk.replace(Path(source), Path(target)) if disk else _replace(source, target)

    def unlink(path: Any, *, dir_fd: int | None = None) -> None:
        disk = of(path) if dir_fd is None else None
        disk.remove(Path(path)) if disk else _unlink(path, dir_fd=dir_fd)

    with (
        mock.patch.object(private_files, "open", opened, create=True),
        mock.patch.object(private_files, "sync_folder", sync_folder),
        mock.patch.object(generations, "sync_folder", sync_folder),
        mock.patch.object(os, "fsync", fsync),
        mock.patch.object(os, "replace", replace),
        mock.patch.object(os, "unlink", unlink),
    ):
        yield


def _back(kept: Path, path: Path) -> None:
    if kept.exists() and path.parent.exists():
        _replace(kept, path)


def _gone(path: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        _unlink(path)
