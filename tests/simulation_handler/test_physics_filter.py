"""The physics filter: a world beside the base in which things lie where physics lets them be."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dsr import AgentError, ConfigError, Memory, Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from simulation_handler.physics_filter import PhysicsFilter

EDGE = 0.04


def see(memory: Memory, now: float, x: float = 0.4) -> None:
    """A camera over the table sees a cube 10 mm too high."""
    memory.update_edge("camera", "cube_1", "RT", pose=Pose((x - 0.4, 0.0, 1.0 - 0.03), stamp=now))


@pytest.fixture
def lockstep() -> Iterator[Lockstep]:
    with Lockstep([AgentSpec("physics", PhysicsFilter)], strict=True) as lockstep:
        base = lockstep.memory
        base.add_node("world", "world")
        base.add_node("table", "table", size=(1.2, 1.2, 0.04))
        base.add_node("camera", "camera")
        base.add_node("cube_1", "cube", size=(EDGE, EDGE, EDGE), mass=0.05, perceived=True)
        base.add_edge("world", "table", "RT", pose=Pose())
        base.add_edge("world", "camera", "RT", pose=Pose((0.4, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)))
        base.add_edge("camera", "cube_1", "RT", pose=Pose((0.0, 0.0, 0.97), stamp=lockstep.clock.now()))
        yield lockstep


def watch(lockstep: Lockstep, seconds: float, x: float = 0.4) -> None:
    end = lockstep.clock.now() + seconds
    while lockstep.clock.now() < end:
        see(lockstep.memory, lockstep.clock.now(), x)
        lockstep.run_for(0.05)


def test_things_lie_in_the_stable_world_and_hover_in_the_base(lockstep: Lockstep) -> None:
    watch(lockstep, 1.5)
    base = lockstep.memory
    stable = base.world("stable")
    believed = stable.transform("world", "cube_1", types=("Virtual_RT", "RT"))
    assert abs(believed.translation[2] - EDGE / 2) < 1e-3
    assert abs(base.transform("world", "cube_1").translation[2] - 0.03) < 1e-6
    assert not base.edges("Virtual_RT") and not base.edges("on")
    assert [edge.key for edge in stable.edges("on")] == [("cube_1", "table", "on")]
    watch(lockstep, 1.5, x=0.5)
    assert abs(stable.transform("world", "cube_1", types=("Virtual_RT",)).translation[0] - 0.5) < 3e-3


def test_after_a_restart_it_goes_on(lockstep: Lockstep) -> None:
    watch(lockstep, 1.0)
    stable = lockstep.memory.world("stable")
    lockstep.run_for(0.1)
    lockstep.kill("physics")
    lockstep.restart("physics")
    watch(lockstep, 1.0, x=0.45)
    assert abs(stable.transform("world", "cube_1", types=("Virtual_RT",)).translation[0] - 0.45) < 3e-3


def test_it_writes_into_its_own_world_only(lockstep: Lockstep) -> None:
    agent = lockstep.runner("physics").agent
    with pytest.raises(AgentError, match="into world 'base'"):
        agent.memory.add_node("cube_9", "cube")


def test_wrong_configurations_are_refused() -> None:
    with pytest.raises(ConfigError, match="belief"):
        Lockstep([AgentSpec("physics", PhysicsFilter, {"agent": {"belief": 1}})])
