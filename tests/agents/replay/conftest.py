"""Recordings to replay: a small one made to order, and one of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from agents.recorder.agent import Recorder
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from dsr import Memory
from dsr.agent import make_agent
from dsr.clock import ManualClock
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork

KEYS = Keys("tabletop")
STEP = 0.05


class Studio:
    """A writer and a recorder on one network and a manual clock."""

    def __init__(self, folder: Path, **config: Any) -> None:
        self.folder = folder
        self.clock = ManualClock()
        network = LocalNetwork(self.clock)
        self._network = network
        self.memory = Memory("tabletop", "writer", transport=network.connect("writer"), clock=self.clock)
        heard = Memory("tabletop", "recorder", transport=network.connect("recorder"), clock=self.clock)
        self._recorder = make_agent(
            Recorder,
            name="recorder",
            config={"folder": str(folder), **config},
            bus=heard.transport,
            keys=KEYS,
            clock=self.clock,
            memory=heard,
        )
        self._recorder.setup()

    def run(self, seconds: float) -> None:
        """Let time pass; the recorder writes every 0.05 s, and there is always something to write."""
        for _ in range(round(seconds / STEP)):
            self.memory.transport.publish(KEYS.truth(), b"")
            for memory in (self.memory, self._recorder.memory):
                memory.poll()
                memory.flush()
            self._network.deliver()
            self._recorder.memory.poll()
            self._recorder.tick(self.clock.now())
            self.clock.advance(STEP)

    def finish(self) -> Path:
        """Close the recording and return its folder."""
        self._recorder.teardown()
        return self.folder


def state(memory: Memory) -> dict[Any, Any]:
    """All that a graph holds, to compare."""
    nodes: dict[Any, Any] = {node.name: (node.type, node.attributes) for node in memory.nodes()}
    return nodes | {edge.key: edge.attributes for edge in memory.edges()}


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path / "run", snapshot_period=3.0)


@pytest.fixture
def counted(studio: Studio) -> Path:
    """Twelve seconds in which a cube's mass tells the time, `cube_old` goes at 4 s and `cube_new` comes at 8 s."""
    memory = studio.memory
    memory.add_node("world", "world")
    memory.add_node("cube_old", "cube")
    memory.add_edge("world", "cube_old", "has")
    for second in range(12):
        memory.add_node("cube_3", "cube", mass=float(second))
        memory.add_edge("world", "cube_3", "Virtual_RT", translation=(0.1 * second, 0.0, 0.0), stamp=studio.clock.now())
        if second == 4:
            memory.remove_node("cube_old")
        if second == 8:
            memory.add_node("cube_new", "box", surprising=True)
        studio.run(1.0)
    return studio.finish()


@pytest.fixture(scope="session")
def hovering(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of six seconds of `hovering_1` in lockstep."""
    run = make_run("hovering_1", sensor="poses", seed=3, folder=tmp_path_factory.mktemp("hovering"))
    scenario = msgspec.structs.replace(run.scenario, settle=3.0, duration=6.0, expectations=[])
    run_lockstep(msgspec.structs.replace(run, scenario=scenario))
    assert run.folder is not None
    return run.folder
