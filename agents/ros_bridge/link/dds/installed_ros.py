"""Services over DDS, asked by a process of the robot's own ROS (`in_ros.py`), which knows its vendor's requests."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import select
import signal
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path
from typing import IO, Any

import msgspec

from agents.ros_bridge.errors import RosAbsentError, RosLinkError, RosSettingError, RosTimeoutError
from agents.ros_bridge.link.link import LinkConfig
from dsr.clock import WALL_CLOCK
from dsr.threads import new_thread

_log = logging.getLogger("dsr.ros")

_SCRIPT = Path(__file__).with_name("in_ros.py")
_SOURCED = 'source "$0" && exec python3 "$@"'
"""The shell command for a `setup.bash`: it changes the environment of the Python that follows"""
_STARTS_WITHIN = 30.0
"""s in which rclpy is imported and joins, on a busy machine too; 1 s on an idle one"""
_ENDS_WITHIN = 2.0
"""s in which the process ends once its input has ended"""
_TAKES_WITHIN = 1.0
"""s in which the process says that it has a request: it reads all the time, so one that says nothing hangs"""
_MOST_RESTARTS = 2
"""Within `_RESTARTS_WITHIN`: a ROS that ends at once would use a whole core by starting"""
_RESTARTS_WITHIN = 20.0
"""s; with `_MOST_RESTARTS` starts of 1 s each, a tenth of a core"""
_SPARE = 0.5
"""s that an answer may come later than asked for, as it goes through one more process"""
_LAST_LINES = 20
"""Of what ROS printed, for the reason of its end"""
_LONGEST_LINE = 10_000
"""Bytes of what ROS printed that are one line at most"""
_HANGS = f"it did not react for {_TAKES_WITHIN:g} s, and was killed"


class _Answer(msgspec.Struct):
    """What the process tells."""

    ready: str | None = None
    call: int | None = None
    taken: bool = False
    response: str | None = None
    absent: bool = False
    failed: str | None = None


class _Pending:
    """A request whose answer is awaited."""

    def __init__(self) -> None:
        self.taken = threading.Event()
        self.done = threading.Event()
        self.answer: _Answer | None = None
        """None also at the end if the process ended before"""


class InstalledRos:
    """Asks services by a process in an installed ROS.

    A process that ended is started again by the next call. One that hangs is ended, and so started again, too.

    Args:
        config: with `installed_ros`: a `setup.bash`, or a Python that has rclpy.
        node: full name of the node in ROS; the process has one of its own, with `_services` at the end.

    Raises:
        RosSettingError: if there is no such file, or it cannot be run.
        RosLinkError: if rclpy is not there, or does not start.
    """

    def __init__(self, config: LinkConfig, node: str) -> None:
        self._config, self._node = config, node
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._prepared: dict[str, str] = {}
        """Types by service, told anew to a process that is started again"""
        self._restarts: deque[float] = deque(maxlen=_MOST_RESTARTS)
        """When they were, s of the monotonic clock"""
        self._closed = False
        self._process = _Process(config, node)
        if not self._process.is_ready(_STARTS_WITHIN):
            reason = self._process.reason
            self._process.close()
            raise RosLinkError(f"installed_ros = {config.installed_ros!r}: {reason}")

    def prepare(self, name: str, type: str) -> None:
        """Begin to look for the server of a service."""
        with self._lock:
            self._prepared[name] = type
            process = self._process
        process.tell({"prepare": name, "type": type})

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Ask once; errors as of `RosLink.call`."""
        end = WALL_CLOCK.monotonic() + timeout
        process, pending = self._running(), _Pending()
        if not process.is_ready(timeout):
            failure = RosLinkError if process.ended else RosTimeoutError
            raise failure(f"{name} cannot be asked: {process.reason}")
        left = max(end - WALL_CLOCK.monotonic(), 0.0)
        number = next(self._numbers)
        process.pending[number] = pending
        try:
            process.tell({"call": number, "name": name, "type": type, "request": request.hex(), "within": left})
            if not process.ended and not WALL_CLOCK.wait(pending.taken, _TAKES_WITHIN):
                process.kill(_HANGS)
                raise RosLinkError(f"{name} cannot be asked: {process.reason}")
            if not process.ended:
                WALL_CLOCK.wait(pending.done, end - WALL_CLOCK.monotonic() + _SPARE)
        finally:
            del process.pending[number]
        answer = pending.answer
        if answer is None and process.ended:
            raise RosLinkError(f"{name} was not answered: {process.reason}")
        if answer is None:
            raise RosTimeoutError(f"{name} did not answer within {timeout:g} s")
        if answer.absent:
            raise RosAbsentError(f"nobody serves {name} ({type}) within {timeout:g} s")
        if answer.response is None:
            raise RosLinkError(f"{name} refused: {answer.failed}")
        return bytes.fromhex(answer.response)

    def problems(self) -> list[str]:
        """Why something cannot be asked, in sentences; empty if all is well."""
        process = self._process
        return [process.reason] if process.ended and not self._closed else sorted(process.refused)

    def close(self) -> None:
        """End the process; harmless when repeated."""
        with self._lock:
            self._closed = True
        self._process.close()

    def _running(self) -> _Process:
        """The process, which may be starting."""
        with self._lock:
            if self._closed:
                raise RosLinkError("the connection to ROS is closed")
            if not self._process.ended:
                return self._process
            now = WALL_CLOCK.monotonic()
            if len(self._restarts) == _MOST_RESTARTS and now - self._restarts[0] < _RESTARTS_WITHIN:
                pause = _RESTARTS_WITHIN - (now - self._restarts[0])
                raise RosLinkError(f"{self._process.reason}; it ends too often, and is started again in {pause:.0f} s")
            self._restarts.append(now)
            _log.warning("the process in the robot's ROS is started again")
            self._process.close()
            self._process = _Process(self._config, self._node)
            for name, type in self._prepared.items():
                self._process.tell({"prepare": name, "type": type})
            return self._process


class _Process:
    """One run of `in_ros.py`. None of its methods waits for long, whatever the process does."""

    def __init__(self, config: LinkConfig, node: str) -> None:
        self.pending: dict[int, _Pending] = {}
        self.refused: set[str] = set()
        """Why services could not be prepared"""
        self.ended = False
        self._began = WALL_CLOCK.monotonic()
        self._ready = threading.Event()
        self._failure = ""
        self._closing = False
        self._printed: deque[str] = deque(maxlen=_LAST_LINES)
        self._writing = threading.Lock()
        try:
            self._process = subprocess.Popen(
                command(config.installed_ros, node), env=environment(config), stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise RosSettingError(f"installed_ros = {config.installed_ros!r} cannot be run: {error}") from error
        assert self._process.stdin is not None
        self._input = self._process.stdin.fileno()
        os.set_blocking(self._input, False)
        self._threads = [new_thread(self._read, "ros-services"), new_thread(self._read_errors, "ros-services-errors")]
        for thread in self._threads:
            thread.start()

    def is_ready(self, timeout: float) -> bool:
        """Wait at most `timeout` s until it can be asked; false if it cannot. One that takes too long is ended."""
        if not WALL_CLOCK.wait(self._ready, timeout):
            if WALL_CLOCK.monotonic() - self._began >= _STARTS_WITHIN:
                self.kill(f"it was not ready within {_STARTS_WITHIN:g} s")
            return False
        return not self._failure and not self.ended

    @property
    def reason(self) -> str:
        """Why nothing can be asked of it, in a sentence."""
        state = "ended" if self.ended else "is not ready"
        printed = next((line for line in reversed(self._printed) if line.strip()), "it said nothing")
        return f"the process in the robot's ROS {state}: {self._failure or printed}"

    def tell(self, command: dict[str, Any]) -> None:
        """Send one command; a process that does not read it is ended, and its end is the answer."""
        data = memoryview(msgspec.json.encode(command) + b"\n")
        if not self._writing.acquire(timeout=_TAKES_WITHIN):
            self.kill(_HANGS)
            return
        try:
            with contextlib.suppress(BrokenPipeError):
                while data and not self._closing:
                    if not _can_be_written(self._input):
                        self.kill(_HANGS)
                        return
                    data = data[os.write(self._input, data) :]
        finally:
            self._writing.release()

    def kill(self, reason: str) -> None:
        """End it at once, whatever it does, and with it what it started."""
        self._failure = self._failure or reason
        if self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._threads[0].join(_ENDS_WITHIN)

    def close(self) -> None:
        """End it; harmless when repeated."""
        assert self._process.stdin is not None
        self._closing = True
        with self._writing:
            self._process.stdin.close()
        try:
            self._process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self.kill(_HANGS)
            self._process.wait()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(_ENDS_WITHIN)

    def _read(self) -> None:
        with contextlib.closing(_output(self._process.stdout)) as output:
            for line in output:
                try:
                    self._hear(msgspec.json.decode(line, type=_Answer))
                except (msgspec.DecodeError, msgspec.ValidationError):
                    _log.warning("the process in the robot's ROS said what was not understood: %.200r", line)
        self._threads[1].join(_ENDS_WITHIN)  # what it printed last is the reason
        with contextlib.suppress(subprocess.TimeoutExpired):  # no zombie stays
            self._process.wait(_ENDS_WITHIN)
        self.ended = True
        if not self._closing:
            _log.warning("%s", self.reason)
        self._ready.set()
        for one in list(self.pending.values()):
            one.taken.set()
            one.done.set()

    def _hear(self, answer: _Answer) -> None:
        pending = self.pending.get(answer.call or 0)
        if answer.call is None and not self._ready.is_set():
            self._failure = answer.failed or ""
            self._ready.set()
        elif answer.call is None and answer.failed is not None:
            self.refused.add(answer.failed)
        elif pending is not None and answer.taken:
            pending.taken.set()
        elif pending is not None:
            pending.answer = answer
            pending.done.set()

    def _read_errors(self) -> None:
        with contextlib.closing(_output(self._process.stderr)) as output:
            while line := output.readline(_LONGEST_LINE):
                text = line.decode(errors="replace").strip()
                self._printed.append(text)
                _log.debug("ROS: %s", text)


def _output(pipe: IO[bytes] | None) -> IO[bytes]:
    assert pipe is not None
    return pipe


def _can_be_written(pipe: int) -> bool:
    """Wait until something can be written to a pipe, or nobody reads it; false if neither is so for too long."""
    waiting = select.poll()
    waiting.register(pipe, select.POLLOUT)
    return bool(waiting.poll(_TAKES_WITHIN * 1000))


def services_node(node: str) -> str:
    """Full name of the process's node, for that of the link."""
    return f"{node}_services"


def command(installed: str, node: str) -> list[str]:
    """The command that starts `in_ros.py`.

    Args:
        installed: a `setup.bash`, which is sourced for the `python3` of the system; or a Python that has rclpy.
        node: full name of the node.

    Raises:
        RosSettingError: if there is no such file.
    """
    path = Path(installed).expanduser()
    if not path.is_file():
        example = "such as /opt/ros/jazzy/setup.bash"
        raise RosSettingError(f"installed_ros = {installed!r}: there is no such file; {example}")
    namespace, _, name = services_node(node).rpartition("/")
    script = [str(_SCRIPT), namespace or "/", name]
    if path.suffix == ".bash":
        return ["bash", "-c", _SOURCED, str(path), *script]
    return [str(path), *script]


def environment(config: LinkConfig) -> dict[str, str]:
    """The variables of the process: ours without our virtual environment, and with domain and reach of the link."""
    left_out = "VIRTUAL_ENV", "PYTHONHOME", "ROS_LOCALHOST_ONLY"  # the last one overrides ours
    found = {key: value for key, value in os.environ.items() if key not in left_out}
    if sys.prefix != sys.base_prefix:  # its python3 is not that of ROS
        ours, parts = str(Path(sys.prefix) / "bin"), found.get("PATH", os.defpath).split(os.pathsep)
        found["PATH"] = os.pathsep.join(part for part in parts if part != ours)
    reach = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET" if config.beyond_loopback else "LOCALHOST"}
    if config.distro == "humble":  # older than the variable above
        reach = {"ROS_LOCALHOST_ONLY": str(int(not config.beyond_loopback))}
    return {**found, **reach, "ROS_DOMAIN_ID": str(config.domain)}
