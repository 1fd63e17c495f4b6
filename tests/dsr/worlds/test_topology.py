"""Who provides and reads which world, in lockstep."""

from __future__ import annotations

import time
from contextlib import closing
from types import SimpleNamespace
from typing import Any

from dsr import Access, Agent, WorldInfo
from dsr.runtime.activity import MOST_USES, Activity, WorldUse
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.status import State, Status
from dsr.runtime.system import AgentSpec
from dsr.runtime.topology import TopologyObserver, WorldEntry, topology
from dsr.worlds import Filter


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
    assert found.worlds[1].last_write == 3.0 and found.worlds[1].write_hz == 0.0


def test_a_status_of_many_worlds_costs_by_its_length() -> None:
    """What was squared took minutes for one message."""

    def cost(worlds: int) -> float:
        uses = [WorldUse(world=f"w{number}", reads=True) for number in range(worlds)]
        status = Status(agent="liar", rid="liar-1", pid=1, state=State.READY, worlds=uses)
        begin = time.process_time()
        found = topology([WorldInfo("base")], [status])
        assert len(found.worlds) == worlds + 1 and found.worlds[-1].readers == ["liar"]
        return time.process_time() - begin

    assert min(cost(8000) for _ in range(3)) < 30 * min(cost(800) for _ in range(3))


def test_of_many_worlds_a_status_tells_first_of_those_that_are_declared() -> None:
    replica = SimpleNamespace(received=0, written=0)
    worlds = [SimpleNamespace(world_name=f"w{number:03}", replica=replica) for number in range(2 * MOST_USES)]
    memory = SimpleNamespace(opened_worlds=lambda: worlds)
    agent: Any = SimpleNamespace(uses_memory=True, world_names=lambda: (("base",), ("zebra",)), memory=memory)
    told = [use.world for use in Activity(agent).uses(0.0)]
    assert len(told) == MOST_USES and told == sorted(told) and {"base", "zebra", "w000"} <= set(told)


class Scribe(Agent):
    """Writes to the world `notes` while there is one."""

    name = "scribe"
    writes = Access(nodes=("cube",), attributes=("order",), worlds=("notes",))

    def tick(self, now: float) -> None:
        if any(info.name == "notes" for info in self.memory.worlds()):
            self.memory.world("notes").add_node("cube_1", "cube", order=int(10 * now) % 1000)

    @staticmethod
    def world_names() -> tuple[tuple[str, ...], tuple[str, ...]]:
        return (), ("notes",)


def test_what_is_written_no_more_has_no_rate() -> None:
    with Lockstep([AgentSpec("scribe", Scribe)], strict=True) as lockstep:
        memory = lockstep.memory
        with closing(TopologyObserver(memory)) as observer:

            def notes() -> WorldEntry:
                [entry] = [entry for entry in observer.look().worlds if entry.info.name == "notes"]
                return entry

            memory.create_world("notes")
            lockstep.run_for(4.0)
            assert notes().there and abs(notes().write_hz - 10.0) < 0.5
            memory.delete_world("notes")
            lockstep.run_for(3.0)
            assert not notes().there and notes().write_hz == 0.0
            memory.create_world("notes")
            lockstep.run_for(4.0)
            assert notes().there and abs(notes().write_hz - 10.0) < 0.5


def test_processes_that_tell_no_status_read_what_they_have_open_and_write_what_they_made() -> None:
    worlds = [WorldInfo("base"), WorldInfo("idea", creator="script"), WorldInfo("other", creator="physics")]
    found = topology(worlds, [], present={"base": ["script"], "idea": ["script"], "other": ["script"]})
    assert [entry.readers for entry in found.worlds] == [["script"]] * 3
    assert [entry.providers for entry in found.worlds] == [[], ["script"], []]
