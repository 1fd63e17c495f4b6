"""The rerun window: the native viewer as a process of its own, reachable from this machine only."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path

from dsr import DsrError
from dsr.clock import WALL_CLOCK

_START_PATIENCE = 10.0  # s to take connections
_PERIOD = 0.1  # s between two attempts
_PATIENCE = 2.0  # s to close in an orderly way


class WindowError(DsrError):
    """The viewer's window cannot be opened."""


class ViewerWindow:
    """A running rerun viewer; a context manager that closes it.

    Args:
        log_file: gets its output; a folder beside it holds the viewer's own files as long as it runs.
        memory_limit: what it may use until it forgets the oldest data, such as "1GB".

    Raises:
        WindowError: if there is no display or no viewer, or it cannot be started.
    """

    def __init__(self, log_file: Path, memory_limit: str) -> None:
        if not has_display(os.environ, sys.platform):
            raise WindowError("there is no display")
        self.log_file = log_file
        port = free_port()
        self.url = viewer_url(port)
        command = [str(native_viewer()), "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", memory_limit]
        command += ["--expect-data-soon", "--hide-welcome-screen"]
        self._scratch = tempfile.TemporaryDirectory(prefix="window-", dir=log_file.parent, ignore_cleanup_errors=True)
        try:
            with log_file.open("ab") as log:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=private_environment(os.environ, Path(self._scratch.name)),
                )
        except OSError as error:
            self._scratch.cleanup()
            raise WindowError(f"{command[0]} cannot be started ({error})") from error
        if not self._wait_for_server(port):
            self.close()
            raise WindowError(f"the viewer does not start, see {log_file}")

    def __enter__(self) -> ViewerWindow:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wait_for_server(self, port: int) -> bool:
        """Whether the viewer takes connections in time; it does so before its window appears."""
        for _ in range(int(_START_PATIENCE / _PERIOD)):
            if self.exit_code is not None:
                return False
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), _PERIOD):
                return True
            WALL_CLOCK.wait(threading.Event(), _PERIOD)
        return False

    @property
    def exit_code(self) -> int | None:
        """Exit code of the viewer, None while it runs."""
        return self._process.poll()

    def close(self) -> None:
        """Close the window; harmless when repeated."""
        self._process.terminate()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._scratch.cleanup()


def has_display(environment: Mapping[str, str], platform: str) -> bool:
    """Whether a window can be shown."""
    return not platform.startswith("linux") or bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


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


def viewer_url(port: int) -> str:
    """The address at which the viewer on this machine that listens on `port` takes data."""
    return f"rerun+http://127.0.0.1:{port}/proxy"


def free_port() -> int:
    """A TCP port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
