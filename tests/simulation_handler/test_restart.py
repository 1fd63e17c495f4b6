"""The agent is killed and comes back: what was explained stays explained, and what is surprising is explained soon."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from dsr import Pose
from dsr.clock import WALL_CLOCK
from dsr.timeline import EXPLAINED, query
from dsr.vocabulary.explained import ExplainedChange
from simulation_handler import agent as agent_module
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.by_hypotheses import ByHypotheses
from simulation_handler.explaining.policy import Explanation
from simulation_handler.explaining.situation import Situation
from simulation_handler.physics.rollouts import Pool
from tests.simulation_handler.occluded import Occlusion
from tests.simulation_handler.rollouts.slowed import slow_down
from tests.simulation_handler.test_agent import NAME, Table
from tests.simulation_handler.test_seeing import LENS
from tests.simulation_handler.worlds import cube_at

SOON = 3.0
"""s after it is ready, in which a surprise is explained"""


@pytest.fixture
def table() -> Iterator[Table]:
    scene = Table()
    scene.memory.update_node("camera", **LENS)
    yield scene
    scene.lockstep.close()


@pytest.fixture
def situations(monkeypatch: pytest.MonkeyPatch) -> list[Situation]:
    """All that were explained."""
    found, explain = list[Situation](), ByHypotheses.explain
    monkeypatch.setattr(ByHypotheses, "explain", lambda self, it: (found.append(it), explain(self, it))[1])
    return found


def build_tower(table: Table) -> None:
    """Cube 3 on cube 4, of which the camera sees only the upper one; cube 5 beside them."""
    table.add("cube_3", cube_at(0.4, -0.1))
    table.add("cube_4", cube_at(0.4, 0.1))
    table.add("cube_5", cube_at(0.3, -0.1))
    table.run(1.5)
    table.truths["cube_3"] = cube_at(0.4, 0.1, 0.06)
    del table.truths["cube_4"]
    table.run(2.0)
    assert ("cube_3", "cube_4") in table.relations()


def explained(table: Table) -> list[str]:
    return [entry.text for entry in query(table.memory, kind=EXPLAINED)]


def restart(table: Table) -> None:
    table.lockstep.kill(NAME)
    table.lockstep.restart(NAME)


@pytest.mark.parametrize("slow", ["start", "jobs"])
def test_what_is_surprising_is_explained_soon_however_slow_the_workers_are(
    table: Table, slow: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    build_tower(table)
    table.lockstep.kill(NAME)
    table.truths["cube_3"] = cube_at(0.3, 0.1, 0.06)
    go_on = slow_down(monkeypatch, tmp_path, starts=slow == "start", jobs="wait" if slow == "jobs" else "run")
    pools = list[Pool]()

    def make_policy(config: BeliefConfig, clock: object) -> ByHypotheses:
        pools.append(Pool(2, clock=WALL_CLOCK))
        pools[0].start()
        return ByHypotheses(pools[0], WALL_CLOCK)

    monkeypatch.setattr(agent_module, "make_policy", make_policy)
    table.lockstep.restart(NAME)
    table.memory.update_node("cube_3", surprising=True)
    before, pids = len(explained(table)), pools[0].pids
    table.run(SOON)
    assert explained(table)[before:] == ["moved_with_supports(cube_3; cube_4)"]
    assert table.error("cube_3") < 0.005
    assert table.belief("cube_4").pose.distance(cube_at(0.3, 0.1))[0] < 0.005
    assert pools[0].pids == pids, "nobody was stuck"
    go_on()


def test_what_was_taken_out_is_not_believed_to_be_back_because_of_where_it_was_last_seen(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.3, -0.1))
    table.run(2.0)
    del table.truths["cube_1"]
    table.run(3.0)
    assert explained(table) == ["removed(cube_1)"]
    restart(table)
    watch = table.memory.watch(node_type="cube", existing=False)
    table.run(3.0)
    assert explained(table) == ["removed(cube_1)"]
    assert table.memory.get_edge("world", "cube_1", "Virtual_RT") is None
    assert table.memory.node("cube_1")["present"] is False
    assert not [change for change in watch.poll() if change.name == "cube_1"]
    table.truths["cube_1"] = cube_at(0.4, 0.2)
    table.run(1.0)
    assert table.error("cube_1") < 0.005 and table.memory.node("cube_1")["present"] is True


def test_what_an_explanation_put_somewhere_is_still_there_by_that_explanation(table: Table) -> None:
    build_tower(table)
    table.truths["cube_3"] = cube_at(0.3, 0.1, 0.06)
    table.run(1.5)
    assert explained(table)[-1] == "moved_with_supports(cube_3; cube_4)"
    sources = {(edge.src, edge.dst): (edge["source"], edge["since"]) for edge in table.memory.edges("on")}
    assert sources["cube_3", "cube_4"][0] == "explanation"
    restart(table)
    table.run(1.0)
    assert sources == {(edge.src, edge.dst): (edge["source"], edge["since"]) for edge in table.memory.edges("on")}


def test_what_moved_along_unseen_was_not_last_glimpsed_where_it_stood_before(
    table: Table, situations: list[Situation]
) -> None:
    build_tower(table)
    table.truths["cube_3"] = cube_at(0.3, 0.1, 0.06)
    table.run(1.5)
    restart(table)
    del situations[:]
    table.truths["cube_3"] = cube_at(0.3, 0.2, 0.06)
    table.run(1.5)
    assert situations[0].glimpsed == {}
    assert situations[0].companions == {"cube_3": {"cube_4"}}, "they have just moved together"
    assert explained(table)[-1] == "moved_with_supports(cube_3; cube_4)"


def test_what_has_just_moved_together_is_known_to_do_so_without_a_restart_too(
    table: Table, situations: list[Situation]
) -> None:
    build_tower(table)
    table.truths["cube_3"] = cube_at(0.3, 0.1, 0.06)
    table.run(1.5)
    del situations[:]
    table.truths["cube_3"] = cube_at(0.3, 0.2, 0.06)
    table.run(1.5)
    assert situations[0].companions == {"cube_3": {"cube_4"}}


def test_what_only_goes_on_is_not_told_anew(table: Table, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = Explanation((ExplainedChange("nothing_changed"),), ("cube_5",), changes_belief=False)
    monkeypatch.setattr(ByHypotheses, "explain", lambda self, situation: nothing)
    table.add("cube_5", cube_at(0.3, -0.1))
    table.run(1.5)
    del table.truths["cube_5"]
    table.add("cube_4", cube_at(0.4, -0.1))
    table.run(10.0)
    assert explained(table) == ["nothing_changed()"]
    restart(table)
    table.run(3.0)
    assert explained(table) == ["nothing_changed()"]


FORGED = {
    "a far pose": Pose((1e12, 0.0, 0.0), stamp=5.0),
    "a pose to come": Pose((0.4, 0.0, 0.02), stamp=1e12),
}


@pytest.mark.parametrize("forged", FORGED)
def test_a_belief_that_cannot_be_is_not_recalled(table: Table, forged: str) -> None:
    """A far one ended the handler at each start; with one of a time to come, no object was seen any more."""
    for name, place in (("cube_1", cube_at(0.4, 0.1)), ("cube_2", cube_at(0.3, -0.1))):
        table.add(name, place)
    table.run(2.0)
    table.lockstep.kill(NAME)
    table.memory.add_edge("world", "cube_1", "Virtual_RT", pose=FORGED[forged])
    table.truths["cube_1"], table.truths["cube_2"] = cube_at(0.4, 0.2), cube_at(0.3, -0.2)
    table.lockstep.restart(NAME)
    table.run(3.0)
    assert table.lockstep.runner(NAME).status().errors == 0
    assert max(table.error("cube_1"), table.error("cube_2")) < 0.005


@pytest.mark.parametrize("what", ["gripper", "held"])
def test_what_is_held_out_of_reach_is_held_by_nobody(table: Table, what: str) -> None:
    """Else its pose would be one that no graph takes, and the handler would end again and again."""
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    table.memory.add_node("gripper", "gripper")
    far, here = Pose((1e12, 0.0, 0.0)), cube_at(0.4, 0.1)
    table.memory.add_edge("world", "gripper", "RT", pose=far if what == "gripper" else here)
    table.memory.add_edge("gripper", "cube_1", "grasping", held_at=far if what == "held" else Pose())
    table.run(2.0)
    assert table.lockstep.runner(NAME).status().errors == 0
    assert table.error("cube_1") < 0.005


def test_what_is_seen_where_it_was_recalled_stays_there_at_first() -> None:
    """What an earlier run has averaged for long is known better than by the first percepts."""
    truths = {f"cube_{k}": Pose((0.2 + 0.1 * k, 0.0, 0.02)) for k in range(4)}
    stayed = 0
    for seed in range(5):
        table = Occlusion(truths, seed, noise=0.002)
        for name, pose in truths.items():
            table.belief.recall(name, pose)
        table.run(0.4)
        stayed += sum(math.dist(table.belief.pose(name).t, pose.t) < 1e-4 for name, pose in truths.items())
    assert stayed >= 10, "of 20; without noise in a first mean all would stay"
