"""A network of memories in one process, on a clock that only the test moves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dsr import Faults, LocalNetwork, ManualClock, Memory, Pose
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece
from dsr.replication.piece_wire import encode_piece


class Net:
    """Memories that share one graph."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=1)
        self.memories: list[Memory] = []

    def join(self, agent: str, **options: object) -> Memory:
        """One more replica."""
        clock = options.pop("clock", self.clock)
        memory = Memory("g", agent, transport=self.network.connect(agent), clock=clock, **options)  # type: ignore[arg-type]
        self.memories.append(memory)
        return memory

    def pump(self, seconds: float = 0.0, faults: Faults | None = None) -> None:
        """Let `seconds` pass and all messages arrive."""
        self.network.faults = faults or Faults()
        for _ in range(max(1, round(seconds / 0.05))):
            self.clock.advance(0.05 if seconds else 0.0)
            for memory in self.memories:
                memory.flush()
            self.network.deliver()
            for memory in self.memories:
                memory.poll()


def reply_of(delta: Delta) -> bytes:
    """A reply in one piece that tells what a delta does: its live dots, of all that it accounts for."""
    kept = sorted((delta.live or frozenset()).difference(add.dot for add in delta.adds))
    return encode_piece(
        Piece(START, None, delta.adds, delta.writes, kept, examined=delta.context, whole=delta.context)
    )


@pytest.fixture
def net() -> Net:
    return Net()


@pytest.fixture(autouse=True)
def private_runtime_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Tests meet nobody but themselves."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("DSR_SECURITY", raising=False)
    yield tmp_path


def tabletop(memory: Memory) -> None:
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.2, 0.8, 0.04))
    memory.add_node("cube_3", "cube", mass=0.05, size=np.array([0.04, 0.04, 0.04]), marker_id=np.int64(3))
    memory.add_edge("world", "table", "RT", pose=Pose((0.3, 0, 0)))
    memory.add_edge("world", "cube_3", "RT", translation=(0.3, 0.1, 0.02), rotation=(0, 0, 0, 1), stamp=5.0)
