"""Speaks with processes that are told what to do: JSON commands, one a line, and an answer to each."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import threading
from collections.abc import Callable, Mapping
from typing import Any

from dsr.clock import WALL_CLOCK

PATIENCE = 30.0  # s


class Told:
    """A process with a method for each of its commands, which takes named arguments."""

    def __init__(self, command: list[str], environment: Mapping[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._lock = threading.Lock()
        assert self._line() == "ready"

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def ask(**fields: Any) -> Any:
            with self._lock:
                assert self._process.stdin is not None
                self._process.stdin.write(json.dumps({"do": name, **fields}) + "\n")
                self._process.stdin.flush()
                answer = self._line()
            assert "ok" in answer, answer
            return answer["ok"]

        return ask

    def stand_still(self) -> None:
        """Stop the process in the middle of what it does, until `go_on`."""
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Let it work again."""
        self._process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """End the process, at the latest by force."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):  # it was killed
                    pipe.close()
        try:
            self._process.wait(PATIENCE / 3)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def kill(self) -> None:
        """End it as a crash does."""
        self._process.kill()
        self._process.wait()

    def _line(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the process ended"
        return json.loads(line)


def eventually(is_so: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """What `is_so` gives as soon as that is true; fails if it is not within `seconds`."""
    end = WALL_CLOCK.monotonic() + seconds
    while not (found := is_so()):
        assert WALL_CLOCK.monotonic() < end, f"not within {seconds} s"
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return found
