"""A worker process as its pool sees it: started, given one job at a time, started again when it dies."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
from pathlib import Path

import psutil

from simulation_handler.physics.rollouts.messages import READY, Reply, RolloutJob, receive_reply, send

_ROOT = Path(__file__).parents[3]
_MESSAGE_PATIENCE = 1.0  # s for a message that has begun: who reads the rest waits for that
_MOST_WORK = 5.0
"""s of processor time on one job from which a worker is stuck: a hundred times what the longest one takes."""
_MOST_REST = _MOST_WORK
"""s for which a worker may have a job and do nothing about it, before it is stuck.

A worker does something while it works, or waits for a processor or a disk.
"""
_AT_WORK = (psutil.STATUS_RUNNING, psutil.STATUS_WAKING, psutil.STATUS_DISK_SLEEP)


class WorkerProcess:
    """A process that simulates scenes; it begins at once, `is_starting` and `job` tell its state.

    It is in a session of its own, so that Ctrl-C reaches only us, and ends when we do, however that happens.
    """

    def __init__(self, now: float) -> None:
        self.deaths = 0
        """How often it has died since it last answered."""
        self._start(now)

    def _start(self, now: float) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "simulation_handler.physics.rollouts.worker", str(theirs.fileno())],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(_search_path())},
            )
        ours.settimeout(_MESSAGE_PATIENCE)
        self.connection = ours
        self.job: int | None = READY.number
        """Number of what it is busy with; None while it waits."""
        self.since = now
        """When it was given that."""
        self._worked = 0.0  # s of processor time that it had used then

    @property
    def is_starting(self) -> bool:
        """Whether it has not said yet that it is ready, which takes as long as the machine is busy."""
        return self.job == READY.number

    def is_stuck(self, now: float) -> bool:
        """Whether nothing is to be expected any more, at time `now` (s), of the job that it has.

        What counts is not how long that took: on a busy machine it may have waited for a processor. Who is still
        starting is not stuck.
        """
        if self.job is None or self.is_starting:
            return False
        try:
            process = psutil.Process(self.pid)
            rests = process.status() not in _AT_WORK
            return self._work() - self._worked > _MOST_WORK or (rests and now - self.since > _MOST_REST)
        except psutil.NoSuchProcess:
            return False  # it has died, which is noticed elsewhere

    def _work(self) -> float:
        """Processor time that it has used, s."""
        times = psutil.Process(self.pid).cpu_times()
        return float(times.user + times.system)

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    def give(self, job: RolloutJob, now: float) -> None:
        """Let the worker simulate a scene, at time `now` (s); raises `OSError` if the worker has died."""
        self.job, self.since = job.number, now
        with contextlib.suppress(psutil.NoSuchProcess):
            self._worked = self._work()
        send(self.connection, job)

    def take(self) -> Reply:
        """Return the worker's answer; raises `OSError` if the worker has died."""
        reply = receive_reply(self.connection)
        self.job, self.deaths = None, 0
        return reply

    def restart(self, now: float) -> str:
        """Start it again; returns how the old one ended."""
        self.close()
        self.deaths += 1
        self._start(now)
        return f"exit code {self._ended}"

    def close(self) -> None:
        """End it at once: it has nothing to lose. Harmless when repeated."""
        self.connection.close()
        self._process.kill()
        self._ended = self._process.wait()
        assert self._process.stdin is not None
        self._process.stdin.close()


def _search_path() -> list[str]:
    """Where the worker finds the code that runs here."""
    given = os.environ.get("PYTHONPATH")
    return [str(_ROOT), *([given] if given else [])]
