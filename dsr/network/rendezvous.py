"""How processes on one machine find each other by graph name, without a server.

Each process leaves a file with its endpoint in `<runtime dir>/dsr/<graph>/` and keeps it locked. The lock
goes with the process, however it dies, so a file that can be locked is a leftover and is removed.
They register one at a time, and each connects to those before it: two that connect to each other at once may fail both.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

from dsr.errors import ConfigError, TransportError
from dsr.files.private_files import lock_file, private_folder
from dsr.forking import leave_to_parent
from dsr.network.keys import check_name

_SUFFIX = ".endpoint"
_LAUNCHER = ".launcher"
_WITH_MEMORY, _WITHOUT_MEMORY = "memory", "no-memory"


def runtime_dir() -> Path:
    """The folder in which this user's processes meet: `$XDG_RUNTIME_DIR/dsr`, or a private folder in the temporary one.

    Raises `TransportError` if it cannot be made, or somebody else's folder or link stands there.
    """
    base = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(base) / "dsr" if base else Path(tempfile.gettempdir()) / f"dsr-{os.getuid()}"
    try:
        return private_folder(folder)
    except PermissionError as error:
        advice = "set XDG_RUNTIME_DIR to a folder of yours"
        raise TransportError(f"the runtime folder {folder} cannot be used: {error.strerror}; {advice}") from error
    except OSError as error:
        raise TransportError(f"the runtime folder {folder} cannot be made: {error.strerror}") from error


class Member(NamedTuple):
    """A live process of a graph."""

    rid: str
    endpoint: str
    has_memory: bool
    """Whether the process holds a replica; others only use the network."""


class Registration:
    """This process's entry in a graph's meeting place, valid until `close` or death.

    Raises `TransportError` if the runtime folder cannot be written.
    """

    def __init__(self, graph: str, rid: str, endpoint: str, *, has_memory: bool = False) -> None:
        self._graph = graph
        folder = runtime_dir() / check_name("graph name", graph)
        try:
            with _one_at_a_time(folder.parent):
                self.seed_peers = members(graph)
                """Those who were there before, oldest first."""
                self._lock = _new_entry(folder, rid)
                self._path = Path(self._lock.name)
                self.rid = rid
                self._lock.write(f"{endpoint} {_WITH_MEMORY if has_memory else _WITHOUT_MEMORY}")
                self._lock.flush()
        except OSError as error:
            raise TransportError(f"cannot register in the runtime folder {folder}: {error.strerror}") from error
        leave_to_parent(self)

    def abandon(self) -> None:
        """Let go of the lock in a forked child: it would keep the entry of a dead parent valid."""
        self._lock.close()

    def rename(self, rid: str) -> None:
        """Be found under another replica id from now on; harmless if somebody removed the entry."""
        path = self._path.with_name(f"{rid}{_SUFFIX}")
        with contextlib.suppress(OSError):
            self._path.rename(path)
            self._path, self.rid = path, rid

    def close(self) -> None:
        """Take the entry back."""
        self._path.unlink(missing_ok=True)
        self._lock.close()
        endpoints(self._graph)
        remove_leftover_claim(self._graph)


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Hold the lock of `folder` itself: nothing is left behind, and it goes with a process that dies."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _new_entry(folder: Path, rid: str) -> IO[str]:
    while True:
        with contextlib.suppress(FileNotFoundError):  # the last process left the graph just now
            private_folder(folder)
            entry = lock_file(folder / f"{rid}{_SUFFIX}")
            if entry is not None:
                return entry


def members(graph: str) -> list[Member]:
    """The live processes in `graph`, oldest first; leftovers are removed."""
    folder = runtime_dir() / check_name("graph name", graph)
    found = [entry for path in folder.glob(f"*{_SUFFIX}") if (entry := _read_live(path))]
    with contextlib.suppress(OSError):  # it is not empty
        folder.rmdir()
    return [member for _, member in sorted(found)]


def endpoints(graph: str) -> list[str]:
    """Endpoints of the live processes in `graph`, oldest first."""
    return [member.endpoint for member in members(graph)]


def graphs() -> list[str]:
    """Names of the graphs in which at least one process of this user takes part; leftovers are removed."""
    found = sorted(runtime_dir().iterdir())
    for file in found:
        if file.suffix == _LAUNCHER:
            remove_leftover_claim(file.stem)
    return [folder.name for folder in found if folder.is_dir() and endpoints(folder.name)]


def running_graph(name: str | None = None, router: str | None = None, *, may_begin: bool = False) -> str:
    """`name`, or else the only graph that runs here.

    Args:
        name: of the graph, if one was given.
        router: endpoint of the router that is joined: a graph that runs elsewhere only has to be named.
        may_begin: the caller can begin a graph.

    Raises `ConfigError`, which says what to do, if none was given and none runs here, or several do.
    """
    if name is not None:
        return check_name("graph name", name)
    found = graphs()
    if len(found) > 1:
        raise ConfigError(f"{len(found)} graphs run here: {', '.join(found)}; name one with --graph")
    if not found and router is not None:
        raise ConfigError(f"which graph? None runs on this machine; name one that is reached at {router} with --graph")
    if not found:
        begin = "name the one to begin with --graph, or " if may_begin else ""
        raise ConfigError(f"no graph runs on this machine; {begin}start a system: dsr run tabletop")
    return found[0]


def _read_live(path: Path) -> tuple[int, Member] | None:
    """When a living process wrote its file, in ns, and what it says; a file that nobody locks is removed."""
    try:
        with path.open(encoding="utf-8") as file:
            if _is_locked(file.fileno()):
                endpoint, _, kind = file.read().partition(" ")
                member = Member(path.stem, endpoint, kind == _WITH_MEMORY)
                return (os.fstat(file.fileno()).st_mtime_ns, member) if kind else None
            path.unlink(missing_ok=True)
    except (OSError, UnicodeDecodeError):
        return None
    return None


def claim_file(graph: str) -> Path:
    """The file that the launcher of `graph` keeps locked; a leftover is removed by who leaves the graph."""
    return runtime_dir() / f"{graph}{_LAUNCHER}"


def lock_claim(graph: str) -> IO[str] | None:
    """The file of a launcher of `graph`, locked as long as it is open; None if another launcher has it.

    Those who look whether it is locked lock it for a moment themselves: they and we do so one at a time.
    """
    path = claim_file(graph)
    with _one_at_a_time(path.parent):
        return lock_file(path)


class Claim(NamedTuple):
    """What the launcher of a graph wrote into its claim."""

    pid: int
    """Process id of the launcher."""
    folder: Path
    """Where the logs of its agents are."""


def read_claim(graph: str) -> Claim | None:
    """The claim of the launcher that runs `graph` on this machine; None if there is none."""
    try:
        path = claim_file(check_name("graph name", graph))
        with _one_at_a_time(path.parent), path.open(encoding="utf-8") as file:
            pid, _, folder = file.read().partition(" ")
            return Claim(int(pid), Path(folder)) if _is_locked(file.fileno()) else None
    except (OSError, ValueError):  # ValueError: it is being written
        return None


def remove_leftover_claim(graph: str) -> bool:
    """Remove the file of a launcher that is gone; whether there still is one, because somebody keeps it locked."""
    path = claim_file(graph)
    with _one_at_a_time(path.parent):
        _read_live(path)
    return path.exists()


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
