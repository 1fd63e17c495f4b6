"""The process that does the runs of a sweep, one after the other."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import Connection, wait

import msgspec

from agents.scenario.judge.result import Result
from agents.scenario.run.staging import HandFinder, Policy, Sensor, make_run

_COLLECT = (100_000, 20, 20)  # much less often than by default: a tenth faster, and runs make little garbage in cycles


class SweepJob(msgspec.Struct, frozen=True, kw_only=True):
    """One run of a sweep: scenario, seed, sensor, policy and how hands are found."""

    name: str
    """Name of the scenario."""
    file: str
    """Path of the scenario's file."""
    seed: int
    sensor: Sensor
    policy: Policy | None
    hands: HandFinder | None = None
    untagged: bool = False


class SweepAnswer(msgspec.Struct, frozen=True):
    """The outcome of a run, or its crash."""

    result: Result | None = None
    reason: str = ""
    """Why there is no result."""


def work(connection: Connection, log: str) -> None:
    """Do the jobs (`SweepJob`) that come, answer each with an `SweepAnswer`; end with the other side.

    It is the leader of a group of processes, so that it can be ended with all that it started. What it prints, and
    what makes it crash, goes to the file `log`.
    """
    with contextlib.suppress(PermissionError):
        os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    os.dup2(output, 1)
    os.dup2(output, 2)
    gc.set_threshold(*_COLLECT)
    threading.Thread(target=_end_with_parent, name="lifeline", daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        while True:
            job = msgspec.msgpack.decode(connection.recv_bytes(), type=SweepJob)
            connection.send_bytes(_answer(job))


def _answer(job: SweepJob) -> bytes:
    from agents.scenario.run.runner import run_lockstep

    try:
        run = make_run(
            job.file,
            seed=job.seed,
            sensor=job.sensor,
            policy=job.policy,
            hands=job.hands,
            untagged=job.untagged,
        )
        return msgspec.msgpack.encode(SweepAnswer(run_lockstep(run)))
    except Exception as error:  # whatever is wrong with one run is that run's failure
        return msgspec.msgpack.encode(SweepAnswer(None, f"{type(error).__name__}: {error}"))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    wait([parent.sentinel])
    os.killpg(os.getpgrp(), signal.SIGKILL)
