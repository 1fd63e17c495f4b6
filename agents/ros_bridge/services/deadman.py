"""Cancels the motions of an arm in ROS when its driver gives no sign of life: a process that outlives the driver.

A controller of ROS carries a trajectory out to its end, whoever sent it has died or not. So the driver starts this
process, and writes to its standard input at each tick. The process cancels all goals when nothing has come for a while,
and when the input ends without a farewell. The driver may ask for it, too, if its own way is blocked.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from agents.ros_bridge.errors import RosError
from agents.ros_bridge.link.actions import ActionClient
from agents.ros_bridge.link.link import LinkConfig
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.messages.types import types_of
from dsr.config.toml import convert

FOLLOW = "control_msgs/action/FollowJointTrajectory"
ALL_GOALS = bytes(16)
"""A goal id of zeros: to cancel it ends all goals of the server"""
_ALIVE, _CANCEL, _FAREWELL = b".", b"c", b"q"
_ANSWER_WITHIN = 2.0
"""s that a controller may take to cancel"""
_TRIES = 5
"""Times that a controller is asked to cancel until it answers"""
_ENDS_WITHIN = 5.0
"""s in which the process ends after a farewell"""


class Deadman:
    """Starts the process, and tells it that the driver lives.

    Args:
        link: options of `LinkConfig`.
        action: FollowJointTrajectory action of the controller.
        patience: s without a sign of life after which all goals are cancelled.
    """

    def __init__(self, link: Mapping[str, Any], action: str, patience: float) -> None:
        options = msgspec.json.encode({"link": link, "action": action, "patience": patience}).decode()
        program = [sys.executable, "-c", f"from {__name__} import main; main()", options]
        self._process = subprocess.Popen(program, stdin=subprocess.PIPE, start_new_session=True)
        assert self._process.stdin is not None
        self._pipe = self._process.stdin
        os.set_blocking(self._pipe.fileno(), False)

    def alive(self) -> None:
        """The driver lives; never waits."""
        self._write(_ALIVE)

    def cancel(self) -> None:
        """Cancel all goals now; never waits."""
        self._write(_CANCEL)

    @property
    def ended(self) -> bool:
        """Whether the process has ended, and watches no more."""
        return self._process.poll() is not None

    def close(self) -> None:
        """The driver ends in good order: nothing is cancelled."""
        self._write(_FAREWELL)
        with contextlib.suppress(OSError):
            self._pipe.close()
        try:
            self._process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _write(self, sign: bytes) -> None:
        with contextlib.suppress(OSError, ValueError):  # a full pipe holds signs enough; a broken one helps nobody
            os.write(self._pipe.fileno(), sign)


def watch(source: int, patience: float, cancel: Callable[[], None]) -> None:
    """Call `cancel` when `source` (a file descriptor) is silent for `patience` s after a sign of life, or ends.

    The source may ask for it, too. Returns after a farewell, or the end of the source.
    """
    is_alive = False
    while True:
        ready, _, _ = select.select([source], [], [], patience if is_alive else None)
        if not ready:
            is_alive = False
            cancel()
            continue
        signs = os.read(source, 4096)
        if _CANCEL in signs:
            cancel()
        if _FAREWELL in signs:
            return
        if not signs:
            cancel()
            return
        is_alive = True


def main() -> None:
    """Run the process for the options in the only argument."""
    options = msgspec.json.decode(sys.argv[1])
    config = convert(options["link"], LinkConfig, "connection of the deadman")
    link, types = open_link(config, "/dsr_deadman"), types_of(config.distro)
    client = ActionClient(link, types, options["action"], FOLLOW)

    def cancel() -> None:
        for _ in range(_TRIES):
            with contextlib.suppress(RosError):
                client.cancel(ALL_GOALS, _ANSWER_WITHIN)
                return

    try:
        with contextlib.suppress(KeyboardInterrupt):
            watch(sys.stdin.fileno(), options["patience"], cancel)
    finally:
        client.close()
        link.close()

