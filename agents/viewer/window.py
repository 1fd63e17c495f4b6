"""The programs of rerun as processes: a window on this machine, or a server for browsers and viewers elsewhere."""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import threading
import urllib.parse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from dsr import DsrError
from dsr.clock import WALL_CLOCK
from dsr.runtime.display import has_display
from dsr.runtime.lifeline import LAUNCHED

LOOPBACK = "127.0.0.1"
"""Address of a machine for itself."""
_START_PATIENCE = 10.0  # s to take connections
_PERIOD = 0.1  # s between two attempts
_PATIENCE = 2.0  # s to close in an orderly way


class WindowError(DsrError):
    """The viewer's window cannot be opened."""


class _RerunProcess:
    """A running program of rerun; a context manager that ends it.

    A program that is started from a terminal gets a process group of its own, so that Ctrl-C there reaches only us. In
    an agent that was launched, the program stays in the agent's group, which ends with the agent.

    Args:
        options: command line of rerun.
        log_file: gets its output; a folder beside it holds rerun's own files as long as it runs.
        listens: (address, port) pairs that take connections once it works.

    Raises:
        WindowError: if rerun is not installed or does not start.
    """

    def __init__(self, options: Sequence[str], log_file: Path, listens: Sequence[tuple[str, int]]) -> None:
        self.log_file = log_file
        command = [str(native_viewer()), *options]
        self._scratch = tempfile.TemporaryDirectory(prefix="window-", dir=log_file.parent, ignore_cleanup_errors=True)
        try:
            with log_file.open("ab") as log:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=private_environment(os.environ, Path(self._scratch.name)),
                    process_group=None if LAUNCHED in os.environ else 0,
                )
        except OSError as error:
            self._scratch.cleanup()
            raise WindowError(f"{command[0]} cannot be started ({error})") from error
        try:
            started = all(self._takes_connections(*place) for place in listens)
        except BaseException:  # most often KeyboardInterrupt
            self.close()
            raise
        if not started:
            self.close()
            raise WindowError(f"the viewer does not start, see {log_file}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _takes_connections(self, address: str, port: int) -> bool:
        """Whether the program takes connections in time; it does so before its window appears."""
        for _ in range(int(_START_PATIENCE / _PERIOD)):
            if self.exit_code is not None:
                return False
            with contextlib.suppress(OSError), socket.create_connection((address, port), _PERIOD):
                return True
            WALL_CLOCK.wait(threading.Event(), _PERIOD)
        return False

    @property
    def exit_code(self) -> int | None:
        """Exit code of the program, None while it runs."""
        return self._process.poll()

    def close(self) -> None:
        """End the program; harmless when repeated."""
        self._process.terminate()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._scratch.cleanup()


class ViewerWindow(_RerunProcess):
    """The window of a native viewer on this machine, which takes data from this machine only.

    Args:
        log_file: see `_RerunProcess`.
        memory_limit: what it may use until it forgets the oldest data, such as "1GB".

    Raises:
        WindowError: if there is no display or no viewer, or it cannot be started.
    """

    def __init__(self, log_file: Path, memory_limit: str) -> None:
        if not has_display(os.environ, sys.platform):
            raise WindowError("there is no display")
        port = free_port()
        self.url = viewer_url(port)
        options = ["--bind", LOOPBACK, "--port", str(port), "--memory-limit", memory_limit]
        super().__init__([*options, "--expect-data-soon", "--hide-welcome-screen"], log_file, [(LOOPBACK, port)])


class ServedView(_RerunProcess):
    """A server of the view: browsers get a page from it, and rerun viewers the data.

    Args:
        log_file: see `_RerunProcess`.
        memory_limit: of the data that is kept for those who come later, such as "1GB".
        bind: address of this machine at which to be reached; `127.0.0.1` for this machine alone.
        port: TCP port of the data.
        web_port: TCP port of the page.

    Raises:
        WindowError: if a port is taken, the address is not ours, or the server does not start.
    """

    def __init__(self, log_file: Path, memory_limit: str, *, bind: str, port: int, web_port: int) -> None:
        for wanted, option in ((port, "--port"), (web_port, "--web-port")):
            check_free(bind, wanted, option)
        self.url = viewer_url(port, _reachable(bind))
        options = ["--serve-web", "--bind", bind, "--port", str(port), "--web-viewer-port", str(web_port)]
        options += ["--server-memory-limit", memory_limit]
        super().__init__(options, log_file, [(_reachable(bind), wanted) for wanted in (port, web_port)])


def check_free(bind: str, port: int, option: str) -> None:
    """Raise `WindowError` unless a server may listen there."""
    try:
        family = socket.getaddrinfo(bind, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as servers do: one that ended takes no port
            probe.bind((bind, port))
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise WindowError(f"port {port} of {bind} is taken; choose another one with {option}") from error
        raise WindowError(f"nobody can be served at {bind}, port {port}: {error.strerror or error}") from error


def _reachable(bind: str) -> str:
    """The address at which this machine reaches a server that was bound to `bind`."""
    return {"0.0.0.0": LOOPBACK, "::": "::1"}.get(bind, bind)


def native_viewer() -> Path:
    """The native program itself: killing the script that wraps it would leave it behind."""
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise WindowError("the package rerun_cli, a part of rerun-sdk, is not installed")
    return Path(package.origin).parent / ("rerun.exe" if os.name == "nt" else "rerun")


def private_environment(environment: Mapping[str, str], scratch: Path) -> dict[str, str]:
    """Make the environment of the viewer: it never removes its temporary files, so they go to `scratch`.

    Without usage analytics, which rerun leaves out, its files included, where `CI` is set.
    """
    return {**environment, "CI": "1", "TMPDIR": str(scratch.absolute())}


def viewer_url(port: int, host: str = LOOPBACK) -> str:
    """The address at which the viewer or server on `host` that listens on `port` takes and gives data."""
    return f"rerun+http://{_in_url(host)}:{port}/proxy"


def page_url(port: int, web_port: int, host: str = LOOPBACK) -> str:
    """The address of the page that shows in a browser what the server on `host` gives.

    The page is dark whatever the browser prefers: the labels have light colours.
    """
    data = urllib.parse.quote(viewer_url(port, host), safe="")
    return f"http://{_in_url(host)}:{web_port}/?url={data}&theme=dark"


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def free_port() -> int:
    """A TCP port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
