"""Folders and files that belong to one user alone: checked before they are used, never reached through another's link.

Whoever shares the machine may put links, folders and files where names can be guessed, such as in `/tmp`. Therefore a
folder is looked at itself (`lstat`), and a new file is made under a name that nobody can have prepared.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import msgspec

FOLDER_MODE = 0o700
FILE_MODE = 0o600
DRAFT_SUFFIX = ".new"
"""Suffix of files that are not complete yet; a crash may leave one behind."""
_OTHERS = 0o077
"""The permissions of everybody but the owner."""


def private_folder(folder: Path) -> Path:
    """Make `folder` for this user alone, parents included, or check the one that is there.

    Permissions that others have on a folder of this user are taken away. A link counts if this user made it.

    Raises:
        PermissionError: if `folder`, or a link in its place, belongs to another user.
        OSError: if it cannot be made or looked at, or is a file.
    """
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=FOLDER_MODE, parents=True)
    for found in (folder.lstat(), folder.stat()):
        if found.st_uid != os.getuid():
            what = "it is a link of another user" if stat.S_ISLNK(found.st_mode) else "it belongs to another user"
            raise PermissionError(errno.EPERM, what, str(folder))
    if not stat.S_ISDIR(found.st_mode):
        raise NotADirectoryError(errno.ENOTDIR, "it is no folder", str(folder))
    if found.st_mode & _OTHERS:
        folder.chmod(FOLDER_MODE)
    return folder


def new_file(file: Path, permissions: int = FILE_MODE) -> IO[bytes]:
    """Make `file` and open it for writing.

    Args:
        file: must not exist; its folder must.
        permissions: of the file, less those that the umask takes away.

    Raises:
        FileExistsError: if anything stands there, a link included.
        OSError: if it cannot be made.
    """
    return open(file, "xb", opener=lambda name, flags: os.open(name, flags | os.O_NOFOLLOW, permissions))


def lock_file(file: Path) -> IO[str] | None:
    """The new or empty file, locked, or None if another process holds it. The lock goes with this process.

    Raises `OSError` if it is a link or cannot be opened.
    """
    while True:
        opened = open(file, "a", encoding="utf-8", opener=_without_links)  # noqa: SIM115 - it is returned
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with contextlib.suppress(FileNotFoundError):
                if file.stat().st_ino == os.fstat(opened.fileno()).st_ino:
                    return opened
        except BlockingIOError:
            opened.close()
            return None
        opened.close()  # it was removed before we had the lock


def _without_links(name: str, flags: int) -> int:
    return os.open(name, flags | os.O_NOFOLLOW, FILE_MODE)


@contextlib.contextmanager
def replacing(file: Path, permissions: int = FILE_MODE) -> Iterator[IO[bytes]]:
    """A new file that takes the place of `file` in one step once it is safely on the disk; none is left on failure.

    Args:
        file: what to replace, if it is there.
        permissions: of the new file, less those that the umask takes away.

    Raises `OSError`.
    """
    draft = file.with_name(f".{file.name}.{secrets.token_hex(8)}{DRAFT_SUFFIX}")
    try:
        with new_file(draft, permissions) as new:
            yield new
            new.flush()
            os.fsync(new.fileno())
        draft.replace(file)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise
    sync_folder(file.parent)


def write_json(value: object, file: Path) -> None:
    """Write a value as JSON that people may read, making the folder if it is missing; in one step, or not at all.

    What is no file, such as `/dev/stdout`, is written to. Raises `OSError`.
    """
    text = msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
    if file.exists() and not file.is_file():
        file.write_bytes(text)
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file, 0o666) as new:
        new.write(text)


def sync_folder(folder: Path) -> None:
    """Make sure that the names in `folder` are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
