"""Several agents in one process on a manual clock."""

from __future__ import annotations

import numpy as np
import pytest

from dsr import ManualClock, Pose
from dsr.agent import Agent
from dsr.errors import AgentError, ConfigError
from dsr.graph.access import Access
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec


class Mover(Agent):
    """Moves a cube about at random."""

    name = "mover"
    rate_hz = 20.0
    writes = Access(nodes=("world", "cube"), edges=("RT",), attributes=("mass",), exclusive=("cube",))

    def setup(self) -> None:
        self.random = np.random.default_rng(self.seed)
        self.memory.add_node("world", "world")
        self.memory.add_node("cube_3", "cube", mass=0.05)
        self.memory.add_edge("world", "cube_3", "RT", pose=Pose())

    def tick(self, now: float) -> None:
        step = self.random.normal(size=3)
        self.memory.update_edge("world", "cube_3", "RT", pose=Pose(step, stamp=now))


class Follower(Agent):
    """Remembers where the cube was at each tick."""

    name = "follower"
    rate_hz = 10.0
    reads = Access(nodes=("cube",), edges=("RT",))

    def setup(self) -> None:
        self.path: list[tuple[float, ...]] = []

    def tick(self, now: float) -> None:
        if "cube_3" in self.memory:
            pose = self.memory.transform("world", "cube_3")
            self.path.append((now, pose.stamp, *pose.translation))


class Trespasser(Agent):
    """Writes what it did not declare."""

    def tick(self, now: float) -> None:
        self.memory.add_node("table", "table")


class Bystander(Agent):
    """Uses only the bus: counts the messages on a device key."""

    uses_memory = False

    def setup(self) -> None:
        self.heard: list[bytes] = []
        self.bus.subscribe(self.keys.device("arm"), lambda key, payload: self.heard.append(payload))


MOVER, FOLLOWER = AgentSpec("mover", Mover), AgentSpec("follower", Follower)


def path_of(seed: int) -> list[tuple[float, ...]]:
    with Lockstep([MOVER, FOLLOWER], seed=seed) as lockstep:
        lockstep.run_for(3.0)
        follower = lockstep.runner("follower").agent
        assert isinstance(follower, Follower)
        return follower.path


def test_two_runs_of_one_seed_are_equal_and_of_two_seeds_are_not() -> None:
    assert path_of(1) == path_of(1)
    assert path_of(1) != path_of(2)


def test_agents_tick_in_declared_order_and_see_what_was_written_in_the_same_instant() -> None:
    for now, stamp, *_ in path_of(3):
        assert stamp == now


def test_the_declared_order_decides() -> None:
    with Lockstep([FOLLOWER, MOVER]) as lockstep:
        lockstep.run_for(1.0)
        follower = lockstep.runner("follower").agent
        assert isinstance(follower, Follower)
        late = {round(now - stamp, 6) for now, stamp, *_ in follower.path[1:]}
    assert late == {0.05}  # the mover's last tick was one of its periods ago


def test_agents_tick_at_their_rates() -> None:
    clock = ManualClock()
    instants: list[float] = []
    with Lockstep([MOVER, FOLLOWER], clock=clock) as lockstep:
        start = clock.now()
        lockstep.run_for(0.5, lambda now: instants.append(now - start))
        assert clock.now() == start + 0.5
    assert instants == pytest.approx([0.05 * n for n in range(10)])


def test_ticks_of_a_time_in_which_the_machine_sleeps_are_left_out() -> None:
    instants: list[float] = []
    with Lockstep([MOVER, FOLLOWER]) as lockstep:
        start = lockstep.clock.now()
        lockstep.run_for(0.1)
        lockstep.suspend(3600.0)
        lockstep.run_for(0.1, lambda now: instants.append(now - start))
        assert lockstep.clock.now() == pytest.approx(start + 3600.2)
    assert instants == pytest.approx([3600.15])


def test_a_run_pauses_when_asked_and_goes_on_from_there() -> None:
    with Lockstep([MOVER, FOLLOWER]) as lockstep:
        start = lockstep.clock.now()
        assert lockstep.run_for(5.0, lambda now: now - start >= 1.0)
        assert lockstep.clock.now() == pytest.approx(start + 1.0)
        assert not lockstep.run_until(start + 2.0)
        assert lockstep.clock.now() == start + 2.0


def test_the_observer_sees_the_graph() -> None:
    with Lockstep([MOVER]) as lockstep:
        lockstep.run_for(0.2)
        assert [node.name for node in lockstep.memory.nodes("cube")] == ["cube_3"]


def test_an_undeclared_write_is_refused() -> None:
    with Lockstep([AgentSpec("trespasser", Trespasser)]) as lockstep:
        lockstep.run_for(0.5)
        assert "which it does not declare" in lockstep.runner("trespasser").status().last_error
        assert "table" not in lockstep.memory
    with Lockstep([AgentSpec("trespasser", Trespasser)], strict=True) as lockstep, pytest.raises(AgentError):
        lockstep.run_for(0.5)


def test_exclusive_writers_are_refused() -> None:
    with pytest.raises(ConfigError, match="only writer of 'cube'"):
        Lockstep([MOVER, AgentSpec("second", Mover)])


def test_a_killed_agent_leaves_the_rest_running_and_comes_back_with_the_whole_graph() -> None:
    with Lockstep([MOVER, FOLLOWER]) as lockstep:
        lockstep.run_for(1.0)
        peers = set(lockstep.memory.peers)
        lockstep.kill("follower")
        with pytest.raises(AgentError, match="not running"):
            lockstep.runner("follower")
        lockstep.run_for(1.0)
        assert lockstep.memory.peers == ["mover-1"]
        lockstep.restart("follower")
        follower = lockstep.runner("follower").agent
        assert "cube_3" in follower.memory
        lockstep.run_for(1.0)
        assert set(lockstep.memory.peers) == peers - {"follower-1"} | {"follower-2"}
        assert isinstance(follower, Follower)
        assert len(follower.path) == 10


def test_killing_the_only_writer_loses_nothing() -> None:
    with Lockstep([MOVER, FOLLOWER]) as lockstep:
        lockstep.run_for(1.0)
        lockstep.kill("mover")
        lockstep.run_for(5.0)
        assert lockstep.runner("follower").agent.memory.node("cube_3")["mass"] == 0.05


def test_a_newcomer_joins_a_graph_in_which_thousands_of_replicas_came_and_went() -> None:
    """What others have seen is told in pieces of its own then, none of which changes anything."""
    with Lockstep([AgentSpec("follower", Follower, {})], later=["follower"]) as lockstep:
        lockstep.memory.add_node("cup", "cube")
        context = lockstep.memory.replica.graph.store.context
        for k in range(9000):
            context.add_range(f"agent_that_was_here_{k}-1", 1, 3)
        lockstep.restart("follower")
        follower = lockstep._memories[-1]
        assert follower.replica.synchroniser.joined and "cup" in follower


def test_restarting_what_runs_and_naming_what_is_not_there_are_errors() -> None:
    with Lockstep([MOVER]) as lockstep:
        with pytest.raises(AgentError, match="is running"):
            lockstep.restart("mover")
        with pytest.raises(ConfigError, match="'moverr'; did you mean 'mover'"):
            lockstep.kill("moverr")


def test_an_agent_without_memory_hears_the_bus() -> None:
    with Lockstep([AgentSpec("bystander", Bystander)]) as lockstep:
        lockstep.bus.publish(lockstep.keys.device("arm"), b"moved")
        lockstep.run_for(0.1)
        bystander = lockstep.runner("bystander").agent
        assert isinstance(bystander, Bystander)
        assert bystander.heard == [b"moved"]
