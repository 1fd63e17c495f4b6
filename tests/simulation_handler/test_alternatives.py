"""Alternatives of the belief in the graph: what is told of islands, when it is written again, and when it goes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.believing.distribution import ATTRIBUTE
from dsr.math3d.tolerance import PoseTolerance
from simulation_handler.graph_io.alternatives import AlternativesWriter, distributions
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld

HERE = Pose((0.3, 0.0, 0.05), covariance=np.diag([1e-4] * 6))
THERE = Pose((0.6, 0.2, 0.05), covariance=np.diag([1e-2] * 6))
BALL = ObjectState(HERE, containers=("cup",))


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock(2.0)
    memory = Memory("table", "simulation_handler", transport=LocalNetwork(clock).connect("me"), clock=clock)
    memory.add_node("world", "world")
    memory.add_node("ball", "ball")
    memory.add_node("cup", "cup")
    for name in ("ball", "cup"):
        memory.add_edge("world", name, "Virtual_RT", pose=HERE)
    return memory


def island(*weights: float, there: Pose = THERE, names: Sequence[str] = ("ball",)) -> Island:
    """A ball that is in the cup, or elsewhere, or gone."""
    states = (BALL, ObjectState(there), ObjectState(None))
    worlds = [
        WeightedWorld(weight, dict.fromkeys(names, state), reason)
        for weight, state, reason in zip(weights, states, ("rests unseen", "elsewhere", "gone"), strict=False)
    ]
    return Island(tuple(sorted(names)), tuple(worlds))


def test_what_is_improbable_is_left_out_and_what_is_certain_is_not_told() -> None:
    (told,) = distributions(island(0.8, 0.19, 0.01))
    assert [one.weight for one in told.alternatives] == pytest.approx([0.8 / 0.99, 0.19 / 0.99])
    assert [one.reason for one in told.alternatives] == ["rests unseen", "elsewhere"]
    assert not list(distributions(island(1.0))) and not list(distributions(island(0.99, 0.01)))


def test_places_that_differ_by_noise_are_one_alternative() -> None:
    near = PoseTolerance(0.01, 0.2)
    known = np.diag([0.001**2] * 3 + [0.01**2] * 3)
    here = HERE.with_covariance(known)
    beside = Pose((HERE.t[0] + 0.005, *HERE.t[1:]), HERE.q)
    turned = Pose(HERE.t, (0.0, 0.0, 1.0, 0.0))
    for other, count in ((beside, 0), (turned, 1), (THERE, 1)):
        for covariance, told in ((known, count), (1e3 * known, 1)):
            states = (ObjectState(here), ObjectState(other.with_covariance(covariance)))
            worlds = tuple(WeightedWorld(0.5, {"ball": state}) for state in states)
            assert len(list(distributions(Island(("ball",), worlds), near))) == told


def test_what_is_certain_again_is_told_in_one_order(memory: Memory, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"ball_{number}" for number in range(8)]
    for name in names:
        memory.add_node(name, "ball")
        memory.add_edge("world", name, "Virtual_RT", pose=HERE)
    writer, told = AlternativesWriter(memory, 3), list[str]()
    writer.update([island(0.8, 0.2, names=(name,)) for name in names])
    monkeypatch.setattr(memory, "update_node", lambda name, **_: told.append(name))
    writer.update([island(1.0, names=(name,)) for name in names])
    assert told == names, "the same seed gives the same messages"
    writer.close()


def test_the_best_place_is_told_where_the_simulation_has_another_one(memory: Memory) -> None:
    writer = AlternativesWriter(memory, 3)
    writer.update([Island(("ball",), (WeightedWorld(0.6, {"ball": ObjectState(THERE)}, "as perceived"),
                                      WeightedWorld(0.4, {"ball": BALL}, "rests in view")))])  # fmt: skip
    told = memory.belief("ball")
    assert told is not None and told.best.pose is not None
    assert told.best.pose.t == pytest.approx(THERE.t) and told.best.reason == "as perceived"
    writer.close()


def test_equal_states_of_several_worlds_are_one_alternative() -> None:
    cup = ObjectState(HERE)
    worlds = tuple(
        WeightedWorld(weight, {"ball": ball, "cup": other})
        for weight, ball, other in (
            (0.5, BALL, cup),
            (0.3, BALL, cup._replace(pose=THERE)),
            (0.2, ObjectState(None), cup._replace(pose=THERE)),
        )
    )
    ball, cups = distributions(Island(("ball", "cup"), worlds))
    assert [(round(one.weight, 3), one.worlds) for one in ball.alternatives] == [(0.8, (0, 1)), (0.2, (2,))]
    assert [(round(one.weight, 3), one.worlds) for one in cups.alternatives] == [(0.5, (0,)), (0.5, (1, 2))]


def test_it_is_written_on_change_beyond_the_tolerance_only(memory: Memory) -> None:
    writer = AlternativesWriter(memory, 3)
    writer.update([island(0.7, 0.3)])
    first = memory.node("ball")[ATTRIBUTE]
    near = Pose((0.62, 0.2, 0.05), covariance=THERE.covariance)
    writer.update([island(0.69, 0.31, there=near)])
    assert memory.node("ball")[ATTRIBUTE] == first
    writer.update([island(0.6, 0.4)])
    found = memory.belief("ball")
    assert found is not None and [one.weight for one in found.alternatives] == pytest.approx([0.6, 0.4])
    writer.update([island(0.6, 0.4, there=Pose((0.9, 0.2, 0.05), covariance=THERE.covariance))])
    found = memory.belief("ball")
    assert found is not None and found.alternatives[1].pose is not None and found.alternatives[1].pose.t[0] == 0.9


def test_a_place_that_gets_surer_is_written_again(memory: Memory) -> None:
    writer = AlternativesWriter(memory, 3)
    writer.update([island(0.7, 0.3)])
    surer = Pose(THERE.t, covariance=np.diag([4e-6] * 6))
    writer.update([island(0.7, 0.3, there=surer)])
    found = memory.belief("ball")
    assert found is not None and found.alternatives[1].pose == surer


def test_it_goes_with_the_worlds_when_all_is_certain_again(memory: Memory) -> None:
    writer = AlternativesWriter(memory, 3)
    writer.update([island(0.6, 0.3, 0.1)])
    assert [info.name for info in memory.worlds()] == ["base", "belief_1", "belief_2"]
    assert memory.world("belief_1").get_transform("world", "ball", types=("Virtual_RT",)) is not None
    writer.update([island(1.0)])
    assert memory.node("ball")[ATTRIBUTE] == "" and [info.name for info in memory.worlds()] == ["base"]
    found = memory.belief("ball")
    assert found is not None and found.best.weight == 1.0


def test_what_an_earlier_run_told_is_taken_back_and_a_thing_that_is_removed_does_no_harm(memory: Memory) -> None:
    AlternativesWriter(memory, 3).update([island(0.6, 0.4)])
    told = memory.node("ball")[ATTRIBUTE]
    later = AlternativesWriter(memory, 3)
    later.update([])
    assert memory.node("ball")[ATTRIBUTE] == told and [info.name for info in memory.worlds()] == ["base", "belief_1"]
    later.update([island(0.6, 0.4)])
    assert memory.node("ball")[ATTRIBUTE] == told, "it has not changed since"
    later.update([island(1.0)])
    assert memory.node("ball")[ATTRIBUTE] == "" and [info.name for info in memory.worlds()] == ["base"]
    memory.remove_node("ball")
    later.update([island(0.6, 0.4)])
    assert [info.name for info in memory.worlds()] == ["base"]


def test_closing_deletes_the_worlds(memory: Memory) -> None:
    writer = AlternativesWriter(memory, 1)
    writer.update([island(0.5, 0.3, 0.2)])
    assert [info.name for info in memory.worlds()] == ["base", "belief_1"]
    writer.close()
    assert [info.name for info in memory.worlds()] == ["base"]
