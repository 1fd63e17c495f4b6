"""Agents of a system hold the parts that its file, their class or the environment names, and all of it survives."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dsr import Agent, ConfigError, Memory, Pose
from dsr.connecting import INTEREST
from dsr.graph.access import Access
from dsr.runtime.launcher import Launcher
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec, System, load_system

AGENTS = '''
from dsr import Access, Agent, Pose

class Cook(Agent):
    rate_hz = 20.0
    interest = ()
    writes = Access(nodes=("part_record", "world", "cube"), edges=("RT",), attributes=("mass",))

    def setup(self):
        self.memory.create_part("kitchen", exist_ok=True)
        if "cup" not in self.memory:
            self.memory.add_node("world", "world")
            self.memory.add_node("cup", "cube", "kitchen", mass=0.0)

    def tick(self, now):
        self.memory.update_node("cup", mass=self.memory.node("cup")["mass"] + 1.0)

class Guest(Agent):
    rate_hz = 20.0
    writes = Access(nodes=("table",))

    def tick(self, now):
        self.memory.add_node("saw_cup" if "cup" in self.memory else "saw_none", "table")
'''
SYSTEM = """
graph = "house"

[[agent]]
name = "cook"
class = "house_agents:Cook"
process = "cook"

[[agent]]
name = "guest"
class = "house_agents:Guest"
process = "shared"
interest = ["kitchen"]

[[agent]]
name = "stranger"
class = "house_agents:Guest"
process = "shared"
"""


class Owner(Agent):
    interest = ()
    writes = Access(nodes=("part_record", "world", "cube"), edges=("RT",))

    def setup(self) -> None:
        self.memory.create_part("kitchen")
        self.memory.add_node("world", "world")
        self.memory.add_node("cup", "cube", "kitchen")
        self.memory.add_edge("world", "cup", "RT", pose=Pose())

    def tick(self, now: float) -> None:
        self.memory.update_edge("world", "cup", "RT", pose=Pose((now, 0, 0)))


class Looker(Agent):
    interest = ("kitchen",)

    def setup(self) -> None:
        self.seen: list[float] = []

    def tick(self, now: float) -> None:
        if (pose := self.memory.get_transform("world", "cup")) is not None:
            self.seen.append(pose.t[0])


def test_in_lockstep_the_system_or_the_class_says_what_an_agent_holds() -> None:
    specs = [AgentSpec("owner", Owner), AgentSpec("by_class", Looker), AgentSpec("all", Looker, interest=("*",)),
             AgentSpec("none", Looker, interest=())]  # fmt: skip
    with Lockstep(specs) as lockstep:
        lockstep.run_for(3.0)
        seen = {name: lockstep.runner(name).agent.seen for name in ("by_class", "all", "none")}  # type: ignore[attr-defined]
        memories: dict[str, Memory] = {name: lockstep.runner(name).agent.memory for name in seen}
    assert len(seen["by_class"]) > 20 and len(seen["all"]) > 10 and seen["none"] == []
    assert memories["by_class"].interest == memories["all"].interest == ("kitchen",)


def test_wrong_names_are_told_with_file_and_line(tmp_path: Path) -> None:
    (tmp_path / "house_agents.py").write_text(AGENTS)
    file = tmp_path / "house.toml"
    file.write_text(SYSTEM.replace('"kitchen"', '"the kitchen"'))
    with pytest.raises(ConfigError, match=r"house\.toml:13.*'the kitchen'"):
        load_system(file)


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def test_agents_hold_what_the_file_names_and_a_state_keeps_all_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(INTEREST, raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    (tmp_path / "house_agents.py").write_text(AGENTS)
    (tmp_path / "house.toml").write_text(SYSTEM)
    system = load_system(tmp_path / "house.toml")
    first, second = (lived(system, tmp_path, run) for run in ("one", "two"))
    assert 0.0 <= first[0] < first[1] <= second[0] < second[1]


def lived(system: System, folder: Path, run: str) -> tuple[float, float]:
    """The cup's mass when all agents have been at work, and a little later."""
    with Launcher(system, folder / run, state=folder / "state") as launcher:
        memory = launcher.memory
        until(lambda: "saw_cup" in memory and "saw_none" in memory)
        until(lambda: memory.interest == ("kitchen",) and "cup" in memory)  # what is listed is held a moment later
        assert launcher.restored == (run == "two")
        begin = memory.node("cup")["mass"]
        until(lambda: memory.node("cup")["mass"] > begin)
        return begin, memory.node("cup")["mass"]
