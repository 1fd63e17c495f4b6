"""A writer and a recorder on one network in memory and a manual clock; a full disk; graphs rebuilt from recordings."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from agents.recorder.agent import Recorder
from agents.recorder.reader import RecordedMessage, read_recording
from dsr import Frame, Memory
from dsr.agent import make_agent
from dsr.clock import ManualClock
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork

KEYS = Keys("tabletop")


class World:
    """A writer and a recorder on one network."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.memory = self.connect("writer")
        self.recorder: Recorder | None = None

    def connect(self, name: str, interest: Iterable[str] | None = ()) -> Memory:
        return Memory("tabletop", name, transport=self.network.connect(name), clock=self.clock, interest=interest)

    def start_recorder(self, **config: Any) -> Recorder:
        memory = self.connect("recorder", Recorder.interest)
        agent = make_agent(
            Recorder,
            name="recorder",
            config={"folder": str(self.folder), **config},
            bus=memory.transport,
            keys=KEYS,
            clock=self.clock,
            memory=memory,
        )
        agent.setup()
        assert isinstance(agent, Recorder)
        self.recorder = agent
        return agent

    def step(self, seconds: float = 0.1) -> None:
        memories = [self.memory] + ([self.recorder.memory] if self.recorder else [])
        for memory in memories:
            memory.poll()
            memory.flush()
        self.network.deliver()
        for memory in memories:
            memory.poll()
        if self.recorder:
            self.recorder.tick(self.clock.now())
        self.clock.advance(seconds)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.step()

    def records(self) -> list[RecordedMessage]:
        return list(read_recording(self.folder))


def rebuilt(records: list[RecordedMessage]) -> Memory:
    """The graph that a reader of the recording ends up with."""
    transport = LocalNetwork().connect("reader")
    memory = Memory("tabletop", "reader", transport=transport, clock=ManualClock(), interest="*")
    for record in records:
        if record.topic == "snapshot" or record.topic.startswith(("d/", "rt/")):
            memory.restore(record.payload)
    return memory


def camera_frame(stamp: float, grey: int = 90) -> Frame:
    depth = np.full((120, 160), 0.8, np.float32)
    return Frame(stamp, {"color": np.full((120, 160, 3), grey, np.uint8), "depth": depth}, {"fx": 200.0})


class FullDisk:
    """A file on a disk on which only so many bytes are free."""

    free = 10**9
    error = errno.ENOSPC

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def write(self, data: bytes) -> int:
        if len(data) > FullDisk.free:
            raise OSError(FullDisk.error, os.strerror(FullDisk.error))
        FullDisk.free -= len(data)
        return self._file.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)
