"""Plans in forks: the best one's world stays and becomes an intention, the others go without trace."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from agents.imagination import Adoption, Imagination
from dsr import ConfigError, Memory, Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.timeline import query
from simulation_handler import SimulationHandler

TOWER = {"name": "tower", "goal": "on(cube_1, cube_2)", "steps": ["pick cube_1", "place cube_1 on cube_2"]}
EDGE = {"name": "edge", "goal": "ontable(cube_1)", "steps": ["place cube_1 at 0.35, 0.61, 0.021"]}
Start = Callable[..., Lockstep]


@pytest.fixture
def start() -> Iterator[Start]:
    """A believed scene with three cubes, two of them stacked, and the agents with some plans."""
    running: list[Lockstep] = []

    def make(*plans: dict[str, Any], **config: Any) -> Lockstep:
        agents = [
            AgentSpec("simulation_handler", SimulationHandler, {"workers": 0}),
            AgentSpec("imagination", Imagination, {"plans": list(plans), "delay": 1.0, **config}),
            AgentSpec("adoption", Adoption),
        ]
        lockstep = Lockstep(agents, strict=True)
        running.append(lockstep)
        memory = lockstep.memory
        memory.add_node("world", "world")
        memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
        memory.add_edge("world", "table", "RT", pose=Pose((0.35, 0.0, 0.0)))
        memory.add_node("camera", "camera")
        memory.add_edge("world", "camera", "RT", pose=Pose((0.35, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0)))
        for name, y, z in (("cube_1", 0.1, 0.02), ("cube_2", -0.1, 0.02), ("cube_3", 0.3, 0.02)):
            memory.add_node(name, "cube", size=(0.04, 0.04, 0.04), mass=0.05, perceived=True)
            pose = Pose((0.0, -y, 0.8 - z), (1.0, 0.0, 0.0, 0.0), lockstep.clock.now(), SURE)
            memory.add_edge("camera", name, "RT", pose=pose)
        return lockstep

    yield make
    for lockstep in running:
        lockstep.close()


SURE = [[1e-6 if row == column else 0.0 for column in range(6)] for row in range(6)]


def worlds(memory: Memory) -> list[str]:
    return [info.name for info in memory.worlds()]


def run(lockstep: Lockstep, seconds: float) -> None:
    """Let time pass in which the cubes are seen all the time."""
    for _ in range(round(seconds / 0.1)):
        for name in ("cube_1", "cube_2", "cube_3"):
            edge = lockstep.memory.edge("camera", name, "RT")
            lockstep.memory.update_edge("camera", name, "RT", pose=edge.pose.with_stamp(lockstep.clock.now()))
        lockstep.run_for(0.1)


def test_the_best_plan_stays_and_is_wanted(start: Start) -> None:
    lockstep = start(EDGE, TOWER, hold=1.0)
    run(lockstep, 1.8)
    assert worlds(lockstep.memory) == ["base", "plan_edge", "plan_tower"]
    run(lockstep, 2.0)
    assert worlds(lockstep.memory) == ["base", "plan_tower"]
    tower = lockstep.memory.world("plan_tower")
    assert tower.get_edge("cube_1", "cube_2", "on") is not None
    [told] = query(tower, kind="adopted")
    assert "edge: cube_1 would fall to the floor" in told.text and "tower: 2 steps" in told.text
    assert [node["goal"] for node in lockstep.memory.nodes("intention")] == ["on(cube_1,cube_2)"]
    assert lockstep.memory.get_edge("cube_1", "cube_2", "on") is None, "nothing has happened yet"
    assert not query(lockstep.memory, kind="imagined")


def test_without_a_plan_that_works_none_stays(start: Start) -> None:
    lockstep = start(EDGE)
    run(lockstep, 4.0)
    assert worlds(lockstep.memory) == ["base"] and not lockstep.memory.nodes("intention")
    assert "would fall to the floor" in lockstep.runner("imagination").agent.degraded


@pytest.mark.parametrize("when", [1.5, 3.0])
@pytest.mark.parametrize("plan", ["tower", "edge"])
def test_a_plan_whose_world_somebody_deletes_is_not_chosen(start: Start, plan: str, when: float) -> None:
    lockstep = start({**TOWER, "name": "later", "steps": ["pick cube_3", *TOWER["steps"]]}, TOWER, EDGE, hold=3.0)
    run(lockstep, when)
    lockstep.memory.delete_world(f"plan_{plan}")
    run(lockstep, 7.0 - when)
    chosen = "later" if plan == "tower" else "tower"
    assert worlds(lockstep.memory) == ["base", f"plan_{chosen}"]
    [told] = query(lockstep.memory.world(f"plan_{chosen}"), kind="adopted")
    assert f"{plan}: world 'plan_{plan}' was deleted" in told.text
    assert len(lockstep.memory.nodes("intention")) == 1


def test_if_all_worlds_are_deleted_nothing_is_chosen(start: Start) -> None:
    lockstep = start(TOWER, EDGE, hold=1.5)
    run(lockstep, 2.0)
    for plan in ("tower", "edge"):
        lockstep.memory.delete_world(f"plan_{plan}")
    run(lockstep, 3.0)
    assert worlds(lockstep.memory) == ["base"] and not lockstep.memory.nodes("intention")
    assert "world 'plan_edge' was deleted" in lockstep.runner("imagination").agent.degraded


def test_a_world_that_is_followed_stays_when_its_plan_is_not_chosen(start: Start) -> None:
    lockstep = start(TOWER, EDGE, hold=1.0)
    run(lockstep, 1.5)
    lockstep.memory.world("plan_edge").fork("watched", follow=True)
    run(lockstep, 3.0)
    assert worlds(lockstep.memory) == ["base", "plan_edge", "plan_tower", "watched"]
    assert len(lockstep.memory.nodes("intention")) == 1


def test_nothing_happens_before_the_scene_is_known(start: Start) -> None:
    lockstep = start({**TOWER, "steps": ["place cube_1 on cube_9"]})
    run(lockstep, 3.0)
    assert worlds(lockstep.memory) == ["base"]


def test_plans_that_cannot_be_read_are_refused(start: Start) -> None:
    with pytest.raises(ConfigError, match="expected"):
        start({**TOWER, "steps": ["put cube_1 down"]})
