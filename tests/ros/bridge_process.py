"""The bridge as a process, and a replica of its graph."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager

from dsr import connect
from dsr.clock import WALL_CLOCK
from dsr.memory import Memory
from dsr.network.rendezvous import endpoints
from dsr.runtime.status import Status, StatusBoard
from tests.agents.ros_bridge.told import eventually

WORLD_FRAME = "map"
"""The frame of ROS that is the memory's world"""


class Bridged:
    """A memory of the graph of a bridge that runs, and what the bridge tells of itself."""

    def __init__(self, memory: Memory, board: StatusBoard) -> None:
        self.memory = memory
        self._board = board

    @property
    def status(self) -> Status:
        """The newest one."""
        heard = self._board.get("ros_bridge")
        assert heard is not None
        return heard.status

    def count(self, what: str) -> int:
        """How often the bridge has counted something."""
        return dict(self.status.counts).get(what, 0)


@contextmanager
def bridge_process(graph: str, domain: int) -> Iterator[Bridged]:
    """Run `dsr ros run` over DDS in a process of its own; it has ended well when the context is left."""
    code = "from agents.ros_bridge.cli import app; app()"
    options = ["--transport", "dds", "--domain", str(domain), "--graph", graph, "--world-frame", WORLD_FRAME]
    command = [sys.executable, "-c", code, "run", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        eventually(lambda: endpoints(graph))
        with (
            connect(graph, agent="observer") as memory,
            closing(StatusBoard(memory.transport, memory.keys, WALL_CLOCK)) as board,
        ):
            eventually(lambda: board.get("ros_bridge"))
            yield Bridged(memory, board)
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=20)
        assert process.returncode == 0 and "Traceback" not in said, said
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
