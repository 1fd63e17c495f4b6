"""Starts nodes of real rclpy as processes, and speaks with them."""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dsr.clock import WALL_CLOCK

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-ros" / "bin" / "python"
PATIENCE = 30.0  # s


class RealNode:
    """A node of rclpy in a process of its own; each method name of `tests.ros.node.Commands` is a method here too."""

    def __init__(self, domain: int, name: str) -> None:
        environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "ROS_", "RMW_"))},
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }
        command = [str(PYTHON), str(ROOT / "tests" / "ros" / "node.py"), name]
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._lock = threading.Lock()
        assert self._line() == "ready"

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def ask(*arguments: Any, **fields: Any) -> Any:
            assert not arguments, "name the arguments"
            with self._lock:
                assert self._process.stdin is not None
                self._process.stdin.write(json.dumps({"do": name, **fields}) + "\n")
                self._process.stdin.flush()
                answer = self._line()
            assert "ok" in answer, answer
            return answer["ok"]

        return ask

    def close(self) -> None:
        """End the process, at the latest by force."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(PATIENCE / 3)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _line(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the node of rclpy ended"
        return json.loads(line)


def a_domain() -> int:
    """A domain that most likely nobody else is in now."""
    return 20 + secrets.randbelow(200)


def eventually(is_so: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """What `is_so` gives as soon as that is true; fails if it is not within `seconds`."""
    end = WALL_CLOCK.monotonic() + seconds
    while not (found := is_so()):
        assert WALL_CLOCK.monotonic() < end, f"not within {seconds} s"
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return found
