"""Who provides and reads which world, in lockstep."""

from __future__ import annotations

from contextlib import closing

from dsr import Access, Agent, WorldInfo
from dsr.runtime.activity import WorldUse
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.status import State, Status
from dsr.runtime.system import AgentSpec
from dsr.worlds import Filter
from dsr.worlds.topology import TopologyObserver, topology


class Talker(Agent):
    name = "talker"
    writes = Access(nodes=("cube",), attributes=("order",))

    def tick(self, now: float) -> None:
        self.memory.add_node("cube_1", "cube", order=int(now) % 1000)


class Copy(Filter):
    name = "copy"
    reads = ("base",)
    writes = "copied"


def test_statuses_tell_who_writes_and_reads_and_how_fast() -> None:
    specs = [AgentSpec("talker", Talker), AgentSpec("copy", Copy), AgentSpec("lost", Copy, {"reads": ["nowhere"]})]
    with Lockstep(specs, strict=True) as lockstep:
        with closing(TopologyObserver(lockstep.memory)) as observer:
            lockstep.run_for(5.0)
            world = lockstep.memory.world("copied")
            lockstep.run_for(0.5)
            found = observer.look()
        entries = {entry.info.name: entry for entry in found.worlds}
        assert list(entries) == ["base", "copied", "nowhere"]
        assert entries["base"].providers == ["talker"] and entries["base"].readers == ["copy"]
        assert entries["copied"].providers == ["copy", "lost"]
        assert not entries["nowhere"].there and entries["nowhere"].readers == ["lost"]
        assert abs(entries["base"].write_hz - 10.0) < 0.5
        assert abs(entries["copied"].write_hz - 10.0) < 0.5
        assert entries["copied"].last_write is not None
        assert lockstep.clock.now() - entries["copied"].last_write < 2.0
        states = {client.agent: client.state for client in found.clients}
        assert states == {"talker": "ready", "copy": "ready", "lost": "degraded"}
        assert world.node("cube_1")["via"] == "base"


def test_a_silent_agent_is_said_to_be_so() -> None:
    use = WorldUse(world="stable", writes=True, last_write=3.0)
    status = Status(agent="physics", rid="physics-1", pid=1, state=State.READY, worlds=[use])
    found = topology([WorldInfo("base"), WorldInfo("stable")], [status], silent=["physics"], present={"stable": ["x"]})
    assert [client.state for client in found.clients] == ["silent", ""]
    assert found.worlds[1].providers == ["physics"] and found.worlds[1].readers == ["x"]
    assert found.worlds[1].last_write == 3.0
