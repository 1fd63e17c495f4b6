"""Services over DDS, asked by a process of the robot's own ROS (`in_ros.py`), which knows its vendor's requests."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path
from typing import Any

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
_SPARE = 0.5
"""s that an answer may come later than asked for, as it goes through one more process"""
_LAST_LINES = 20
"""Of what ROS printed, for the reason of its end"""


class _Answer(msgspec.Struct):
    """What the process tells."""

    ready: str | None = None
    call: int | None = None
    response: str | None = None
    absent: bool = False
    failed: str | None = None


class _Pending:
    """A request whose answer is awaited."""

    def __init__(self) -> None:
        self.done = threading.Event()
        self.answer: _Answer | None = None
        """None also at the end if the process ended before"""


class InstalledRos:
    """Asks services by a process in an installed ROS. A process that ended is started again by the next call.

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
        self._closed = False
        self._process = _Process(config, node)

    def prepare(self, name: str, type: str) -> None:
        """Begin to look for the server of a service."""
        with self._lock:
            self._prepared[name] = type
            process = self._process
        process.tell({"prepare": name, "type": type})

    def call(self, name: str, type: str, request: bytes, timeout: float) -> bytes:
        """Ask once; errors as of `RosLink.call`."""
        process, pending = self._running(), _Pending()
        number = next(self._numbers)
        process.pending[number] = pending
        try:
            if process.ended:
                raise RosLinkError(f"{name} cannot be asked: {process.reason}")
            process.tell({"call": number, "name": name, "type": type, "request": request.hex(), "within": timeout})
            WALL_CLOCK.wait(pending.done, timeout + _SPARE)
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
        """Why nothing can be asked, in sentences; empty if all is well."""
        process = self._process
        return [process.reason] if process.ended and not self._closed else []

    def close(self) -> None:
        """End the process; harmless when repeated."""
        with self._lock:
            self._closed = True
        self._process.close()

    def _running(self) -> _Process:
        with self._lock:
            if self._closed:
                raise RosLinkError("the connection to ROS is closed")
            if self._process.ended:
                _log.warning("%s; it is started again", self._process.reason)
                self._process.close()
                self._process = _Process(self._config, self._node)
                for name, type in self._prepared.items():
                    self._process.tell({"prepare": name, "type": type})
            return self._process


class _Process:
    """One run of `in_ros.py`."""

    def __init__(self, config: LinkConfig, node: str) -> None:
        self.pending: dict[int, _Pending] = {}
        self.ended = False
        self._ready = threading.Event()
        self._failure = ""
        self._printed: deque[str] = deque(maxlen=_LAST_LINES)
        self._writing = threading.Lock()
        try:
            self._process = subprocess.Popen(
                command(config.installed_ros, node), env=environment(config), stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise RosSettingError(f"installed_ros = {config.installed_ros!r} cannot be run: {error}") from error
        self._threads = [new_thread(self._read, "ros-services"), new_thread(self._read_errors, "ros-services-errors")]
        for thread in self._threads:
            thread.start()
        if not WALL_CLOCK.wait(self._ready, _STARTS_WITHIN) or self._failure or self.ended:
            reason = self.reason
            self.close()
            raise RosLinkError(f"installed_ros = {config.installed_ros!r}: {reason}")

    @property
    def reason(self) -> str:
        """Why nothing can be asked of it, in a sentence."""
        said = self._failure or next((line for line in reversed(self._printed) if line.strip()), "it said nothing")
        return f"the process in the robot's ROS {'ended' if self.ended else 'does not answer'}: {said}"

    def tell(self, command: dict[str, Any]) -> None:
        """Send one command; one that cannot be sent is answered by the end of the process."""
        assert self._process.stdin is not None
        with self._writing, contextlib.suppress(OSError, ValueError):
            self._process.stdin.write(msgspec.json.encode(command).decode() + "\n")
            self._process.stdin.flush()

    def close(self) -> None:
        """End it; harmless when repeated."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError, ValueError):
            self._process.stdin.close()
        try:
            self._process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(_ENDS_WITHIN)

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                answer = msgspec.json.decode(line, type=_Answer)
            except (msgspec.DecodeError, msgspec.ValidationError):
                _log.warning("the process in the robot's ROS said what was not understood: %.200s", line.strip())
                continue
            pending = self.pending.get(answer.call or 0)
            if pending is not None:
                pending.answer = answer
                pending.done.set()
            elif answer.call is None:
                self._failure = answer.failed or ""
                self._ready.set()
        self._threads[1].join(_ENDS_WITHIN)  # what it printed last is the reason
        self.ended = True
        self._ready.set()
        for one in list(self.pending.values()):
            one.done.set()

    def _read_errors(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._printed.append(line.strip())
            _log.debug("ROS: %s", line.strip())


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
    found = {key: value for key, value in os.environ.items() if key not in ("VIRTUAL_ENV", "PYTHONHOME")}
    if sys.prefix != sys.base_prefix:  # its python3 is not that of ROS
        ours, parts = str(Path(sys.prefix) / "bin"), found.get("PATH", os.defpath).split(os.pathsep)
        found["PATH"] = os.pathsep.join(part for part in parts if part != ours)
    reach = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET" if config.beyond_loopback else "LOCALHOST"}
    if config.distro == "humble":  # older than the variable above
        reach = {"ROS_LOCALHOST_ONLY": str(int(not config.beyond_loopback))}
    return {**found, **reach, "ROS_DOMAIN_ID": str(config.domain)}
