"""What a launcher starts: an agent as a process of its own, or in a process that it shares with others.

Each process leads a session of its own, so that Ctrl-C in the terminal reaches only the launcher; whatever it started
is in its process group and ends with it. Its standard input is its lifeline (dsr/runtime/lifeline.py).
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import subprocess
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from dsr.runtime.forked import Process
from dsr.runtime.lifeline import LAUNCHED
from dsr.runtime.orders import EXIT_FAILED, EXIT_USAGE, Lines, StartAgent, decode_report, encode_line

_MOST_READ = 1 << 16  # bytes
_log = logging.getLogger("dsr.runtime.launcher")


def exit_text(code: int | None) -> str:
    """How a process ended, in words; a negative code is a signal."""
    return f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"


class Launched(Protocol):
    """An agent that was started, or can be."""

    @property
    def logs(self) -> Sequence[Path]:
        """Files with what it says and why it ended, its own first."""

    @property
    def pid(self) -> int | None:
        """Id of its process; None without one."""

    def start(self, restarts: int) -> None:
        """Start it; it was so often started before."""

    def exit_code(self) -> int | None:
        """How it ended, told once, after which it can be started again: negative for a signal; None if it has not."""

    def is_gone(self) -> bool:
        """Whether no process of it is left."""

    def terminate(self) -> None:
        """Ask its process to end."""

    def kill(self) -> None:
        """End its process, and all that this one started, at once."""


class Program:
    """A process: its command, and whether it runs.

    Args:
        command: the program and its arguments.
        log_file: gets its output; appended to at each start.
        environment: of the process.
        ahead: processes that were forked ahead. The next one that is left gets the command, which begins with `PYTHON`;
            without any, a process is started anew.
    """

    def __init__(
        self, command: Sequence[str], log_file: Path, environment: Mapping[str, str], ahead: list[Process] | None = None
    ) -> None:
        self.log_file = log_file
        self._command = list(command)
        self._environment = {**environment, "PYTHONUNBUFFERED": "1"}
        self._ahead = [] if ahead is None else ahead
        self._process: subprocess.Popen[bytes] | Process | None = None

    @property
    def logs(self) -> Sequence[Path]:
        """See `Launched.logs`."""
        return (self.log_file,)

    @property
    def pid(self) -> int | None:
        """Id of the running process; None while there is none."""
        return self._process.pid if self._process else None

    def start(self, restarts: int, more: Sequence[str] = (), descriptors: Collection[int] = ()) -> None:
        """Start the process, with `more` arguments, and with open descriptors."""
        command, environment = [*self._command, *more], {**self._environment, LAUNCHED: str(restarts)}
        with self.log_file.open("ab") as log:
            if self._ahead:
                self._process = self._ahead.pop()
                self._process.begin(command, self.log_file.stem, log.fileno(), environment, descriptors)
                return
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                pass_fds=descriptors,
                start_new_session=True,
            )

    def write(self, line: bytes) -> None:
        """Write to the process's standard input; a process that has just died is not told."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write(line)
                self._process.stdin.flush()

    def exit_code(self) -> int | None:
        """See `Launched.exit_code`."""
        if self._process is None or not _has_exited(self._process):
            return None
        return self._reap(self._process)

    def is_gone(self) -> bool:
        """See `Launched.is_gone`."""
        self.exit_code()
        return self._process is None

    def terminate(self) -> None:
        """See `Launched.terminate`."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.terminate()

    def kill(self) -> None:
        """See `Launched.kill`."""
        if self._process is not None:
            self._reap(self._process)

    def _reap(self, process: subprocess.Popen[bytes] | Process) -> int:
        """Kill what is left of the process group and collect the exit code."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        code = process.wait()
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        self._process = None
        return code


def _has_exited(process: subprocess.Popen[bytes] | Process) -> bool:
    """Whether it has, without reaping it: until then nobody else can get its process group's number."""
    return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


class SharedProgram:
    """A process that several agents share (dsr/runtime/shared_process.py), and how those ended that did.

    Args:
        name: of the process.
        program: the process; it also gets the argument `--reports`.
    """

    def __init__(self, name: str, program: Program) -> None:
        self.program = program
        self._name = name
        self._running: set[str] = set()
        self._ended: dict[str, int] = {}
        self._reports: int | None = None
        self._lines = Lines()
        self._asked = False

    def start(self, order: StartAgent) -> None:
        """Start an agent in the process, which is started if it does not run."""
        self._look()
        if self.program.pid is None:
            self._reports, theirs = os.pipe()
            os.set_blocking(self._reports, False)
            self.program.start(0, ["--reports", str(theirs)], [theirs])
            os.close(theirs)
        self.program.write(encode_line(order))
        self._running.add(order.name)

    def exit_code(self, agent: str) -> int | None:
        """How an agent ended, told once: by itself, or with the process. None if it has not."""
        self._look()
        return self._ended.pop(agent, None)

    def is_gone(self) -> bool:
        """Whether no process is left."""
        self._look()
        return self.program.pid is None

    def terminate(self) -> None:
        """Ask the process, once, to end all its agents and itself."""
        if not self._asked:
            self._asked = True
            self.program.terminate()

    def kill(self) -> None:
        """End the process and all in it at once."""
        self.program.kill()
        self._close_reports()

    def _look(self) -> None:
        """Learn which agents have ended: each that has reported it, and all others if the process has ended."""
        code = self.program.exit_code()  # first: its last reports are then there to be read
        for line in self._lines.take(self._read()):
            report = decode_report(line)
            self._end([report.name], report.code)
        if code is not None:
            self._lose(code)
            self._close_reports()

    def _lose(self, code: int) -> None:
        """Note that the process took the agents along that had not ended: that is a crash, whatever its code is."""
        lost = sorted(self._running)
        if lost and not self._asked:
            _log.warning("process %s ended with %s, and with it %s", self._name, exit_text(code), ", ".join(lost))
        self._end(lost, EXIT_FAILED if code in (0, EXIT_USAGE) else code)

    def _end(self, agents: Sequence[str], code: int) -> None:
        self._running.difference_update(agents)
        self._ended.update(dict.fromkeys(agents, code))

    def _read(self) -> bytes:
        if self._reports is not None:
            with contextlib.suppress(BlockingIOError):
                return os.read(self._reports, _MOST_READ)
        return b""

    def _close_reports(self) -> None:
        if self._reports is not None:
            os.close(self._reports)
            self._reports, self._lines = None, Lines()


class Seat:
    """An agent's place in a shared process.

    Args:
        shared: the process.
        order: starts the agent.
    """

    def __init__(self, shared: SharedProgram, order: StartAgent) -> None:
        self._shared = shared
        self._order = order

    @property
    def logs(self) -> Sequence[Path]:
        """See `Launched.logs`; what crashed the process is told in the log of that."""
        return Path(self._order.log_file), self._shared.program.log_file

    @property
    def pid(self) -> int | None:
        """See `Launched.pid`."""
        return self._shared.program.pid

    def start(self, restarts: int) -> None:
        """See `Launched.start`."""
        self._shared.start(msgspec.structs.replace(self._order, restarts=restarts))

    def exit_code(self) -> int | None:
        """See `Launched.exit_code`."""
        return self._shared.exit_code(self._order.name)

    def is_gone(self) -> bool:
        """See `Launched.is_gone`."""
        return self._shared.is_gone()

    def terminate(self) -> None:
        """See `Launched.terminate`: the others in the process end, too."""
        self._shared.terminate()

    def kill(self) -> None:
        """See `Launched.kill`: the others in the process end, too."""
        self._shared.kill()
