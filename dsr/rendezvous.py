"""How processes on one machine find each other by graph name, without a server.

Each process leaves a file with its endpoint in `<runtime dir>/dsr/<graph>/` and keeps it locked. The lock
goes with the process, however it dies, so a file that can be locked is a leftover and is removed.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import tempfile
from pathlib import Path
from typing import IO

from dsr.errors import ConfigError, TransportError
from dsr.keys import check_name

_SUFFIX = ".endpoint"


def runtime_dir() -> Path:
    """Where this user's processes meet: `$XDG_RUNTIME_DIR/dsr`, or a private folder in the temporary one.

    Raises `TransportError` if the folder belongs to somebody else.
    """
    base = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(base) / "dsr" if base else Path(tempfile.gettempdir()) / f"dsr-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise TransportError(f"the runtime folder {folder} cannot be made: {error.strerror}") from error
    if folder.stat().st_uid != os.getuid():
        raise TransportError(f"{folder} belongs to another user; set XDG_RUNTIME_DIR to a folder of yours")
    return folder


class Registration:
    """This process's entry in a graph's meeting place, valid until `close` or death."""

    def __init__(self, graph: str, rid: str, endpoint: str) -> None:
        self._graph = graph
        folder = runtime_dir() / check_name("graph name", graph)
        lock = None
        while lock is None:
            folder.mkdir(mode=0o700, exist_ok=True)
            with contextlib.suppress(FileNotFoundError):  # the last process left the graph just now
                lock = lock_file(folder / f"{rid}{_SUFFIX}")
        self._lock = lock
        self._lock.write(endpoint)
        self._lock.flush()

    def close(self) -> None:
        """Take the entry back."""
        Path(self._lock.name).unlink(missing_ok=True)
        self._lock.close()
        endpoints(self._graph)


def lock_file(path: Path) -> IO[str] | None:
    """The new or empty file `path`, locked, or None if another process holds it. The lock goes with this process."""
    while True:
        file = path.open("a", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and path.stat().st_ino == os.fstat(file.fileno()).st_ino:
                return file
        except BlockingIOError:
            file.close()
            return None
        file.close()  # it was removed before we had the lock


def endpoints(graph: str, *, but: str = "") -> list[str]:
    """Endpoints of the live processes in `graph`, without that of replica `but`; leftovers are removed."""
    folder = runtime_dir() / check_name("graph name", graph)
    found = []
    for path in sorted(folder.glob(f"*{_SUFFIX}")):
        if path.stem != but and (endpoint := _read_live(path)):
            found.append(endpoint)
    with contextlib.suppress(OSError):  # it is not empty
        folder.rmdir()
    return found


def graphs() -> list[str]:
    """Names of the graphs in which at least one process of this user takes part."""
    return [folder.name for folder in sorted(runtime_dir().iterdir()) if folder.is_dir() and endpoints(folder.name)]


def running_graph(name: str | None = None) -> str:
    """`name`, or else the only graph that runs here. Raises `ConfigError` if there is none, or a choice."""
    if name is not None:
        return check_name("graph name", name)
    found = graphs()
    if len(found) != 1:
        which = f"{len(found)} graphs run here: {', '.join(found)}" if found else "no graph runs on this machine"
        raise ConfigError(f"{which}; name one with --graph, or start a system: dsr run tabletop")
    return found[0]


def _read_live(path: Path) -> str | None:
    """The endpoint in a file whose writer lives; a file that nobody locks is removed."""
    try:
        with path.open(encoding="utf-8") as file:
            if _is_locked(file.fileno()):
                return file.read().strip() or None
            path.unlink(missing_ok=True)
    except OSError:
        return None
    return None


def _is_locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def free_port() -> int:
    """A TCP port of the loopback interface that nobody uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
