"""The token of a tool server: whoever asks over HTTP shows it, and only this user can read the file that holds it."""

from __future__ import annotations

import os
import re
import secrets
import stat
from pathlib import Path

from dsr.errors import ConfigError
from dsr.files.private_files import new_file, private_folder

_BYTES = 32
"""Random bytes of a new token: as many as nobody guesses"""
_TOKEN = re.compile(r"[A-Za-z0-9._~+/=-]{32,256}")
"""What may stand behind `Bearer` (RFC 6750), at least as long as 24 random bytes"""


def default_token_file(graph: str) -> Path:
    """Where the token of a graph's server is kept: it stays the same from start to start, as configurations name it."""
    base = os.environ.get("XDG_STATE_HOME")
    folder = Path(base) if base else Path.home() / ".local" / "state"
    return folder / "dsr" / f"assist-{graph}.token"


def read_or_make_token(file: Path) -> str:
    """The token in a file; a new one if there is no file.

    Raises:
        ConfigError: for a file that others may read or write, that belongs to another user, or holds no token.
        OSError: if it cannot be read or made.
    """
    try:
        opened = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return _new_token(file)
    try:
        found = os.fstat(opened)
        if not stat.S_ISREG(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
            raise ConfigError(f"{file}: expected a file of this user that others cannot read: chmod 600 {file}")
        text = os.read(opened, 1024).decode("ascii", "replace").strip()
    finally:
        os.close(opened)
    if _TOKEN.fullmatch(text) is None:
        raise ConfigError(f"{file}: expected a token of 32 to 256 letters and digits; remove the file for a new one")
    return text


def _new_token(file: Path) -> str:
    if not file.parent.exists():
        private_folder(file.parent)
    token = secrets.token_urlsafe(_BYTES)
    with new_file(file) as new:
        new.write(f"{token}\n".encode())
    return token
