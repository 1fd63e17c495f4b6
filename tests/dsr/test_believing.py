"""Where things may be: the attribute, samples, and the leading alternatives as worlds."""

from __future__ import annotations

import math

import numpy as np
import pytest

import dsr
from dsr import Alternative, LocalNetwork, ManualClock, Memory, Pose, Whereabouts
from dsr.believing.distribution import ATTRIBUTE, decoded, encoded, whereabouts_of
from dsr.believing.worlds import BeliefWorlds, leading

HERE = Pose((0.3, 0.1, 0.05), stamp=2.0, covariance=np.diag([1e-4] * 3 + [1e-2] * 3))
THERE = Pose((0.6, -0.2, 0.05), covariance=np.diag([4e-4, 1e-4, 1e-6, 1e-2, 1e-2, 1.0]))


def spread(weight: float = 0.7) -> Whereabouts:
    """A ball that is in a cup, or in a hand, or gone."""
    rest = 1.0 - weight
    alternatives = (
        Alternative(weight=weight, pose=HERE, containers=("cup",)),
        Alternative(weight=0.75 * rest, pose=THERE, reason="taken", hand="hand_0", worlds=(1,)),
        Alternative(weight=0.25 * rest, pose=None, reason="gone", worlds=(2,)),
    )
    return Whereabouts("ball", alternatives, ("ball",), (weight, 0.75 * rest, 0.25 * rest))


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock(2.0)
    memory = Memory("table", "tester", transport=LocalNetwork(clock).connect("tester"), clock=clock)
    memory.add_node("world", "world")
    for name, kind in (("ball", "ball"), ("cup", "cup"), ("hand_0", "hand")):
        memory.add_node(name, kind)
    memory.add_edge("world", "ball", "Virtual_RT", pose=HERE)
    memory.add_edge("ball", "cup", "in", source="contact")
    return memory


def tell(memory: Memory, where: Whereabouts) -> None:
    memory.update_node(where.name, **{ATTRIBUTE: encoded(where)})


def test_the_attribute_tells_all_but_the_believed_pose(memory: Memory) -> None:
    told = spread()
    tell(memory, told)
    found = memory.belief("ball")
    assert found is not None and found.best.pose == HERE
    assert [one.weight for one in found.alternatives] == pytest.approx([0.7, 0.225, 0.075])
    assert [one.holders for one in found.alternatives] == [one.holders for one in told.alternatives]
    other = found.alternatives[1].pose
    assert other is not None and other.t == THERE.t and other.cov == pytest.approx(THERE.cov, rel=1e-3, abs=1e-12)
    assert found.gone == pytest.approx(0.075)


def test_what_is_where_the_best_is_moves_along_with_it(memory: Memory) -> None:
    wide = HERE.with_covariance(np.diag([1e-2] * 6))
    alternatives = (Alternative(weight=0.9, pose=HERE), Alternative(weight=0.1, pose=wide, worlds=(1,)))
    tell(memory, Whereabouts("ball", alternatives, ("ball",), (0.9, 0.1)))
    memory.add_edge("world", "ball", "Virtual_RT", pose=Pose((1.0, 0.0, 0.0), covariance=HERE.covariance))
    found = memory.belief("ball")
    assert found is not None and [one.pose.t for one in found.alternatives if one.pose] == [(1.0, 0.0, 0.0)] * 2
    deviations = [one.pose.cov[0] for one in found.alternatives if one.pose and one.pose.cov]
    assert deviations == pytest.approx([1e-4, 1e-2])


def test_without_the_attribute_one_alternative_is_certain(memory: Memory) -> None:
    found = memory.belief("ball")
    assert found is not None and found.best.weight == 1.0 and found.best.pose == HERE
    memory.update_node("ball", present=False)
    found = memory.belief("ball")
    assert found is not None and found.gone == 1.0
    assert memory.belief("cup") is None
    with pytest.raises(dsr.NodeNotFoundError):
        memory.belief("nobody")


@pytest.mark.parametrize(
    "text",
    ["{", "[]", '{"island":[],"weights":[],"alternatives":[]}', "x" * 100_000,
     '{"island":["a"],"weights":[1],"alternatives":[{"weight":-1}]}',
     '{"island":["a"],"weights":[1],"alternatives":[{"weight":1e400}]}',
     '{"island":["a"],"weights":[1],"alternatives":[{"weight":1,"at":[1e999,0,0]}]}',
     '{"island":["a"],"weights":[1],"alternatives":[{"weight":1,"covariance":[1,2]}]}'],
)  # fmt: skip
def test_what_cannot_be_used_is_no_belief(text: str) -> None:
    assert decoded("ball", text, HERE) is None


def test_samples_are_of_the_distribution_and_repeat_with_the_seed() -> None:
    samples = spread().samples(4000, seed=5)
    gone = sum(sample is None for sample in samples) / len(samples)
    assert gone == pytest.approx(0.075, abs=0.02)
    here = np.array([sample.t for sample in samples if sample is not None and sample.t[1] > -0.05])
    assert len(here) / len(samples) == pytest.approx(0.7, abs=0.03)
    assert here.mean(axis=0) == pytest.approx(HERE.t, abs=0.002)
    assert here.std(axis=0) == pytest.approx([0.01] * 3, rel=0.1)
    assert samples == spread().samples(4000, seed=5) != spread().samples(4000, seed=6)


def test_weights_must_be_a_distribution() -> None:
    for weights in ((), (0.5,), (0.5, 0.6), (-0.1, 1.1)):
        with pytest.raises(ValueError, match="weights"):
            Whereabouts("ball", tuple(Alternative(weight=weight, pose=None) for weight in weights))


def test_leading_alternatives_are_worlds_to_be_opened(memory: Memory) -> None:
    tell(memory, spread())
    worlds = BeliefWorlds(memory, most=3)
    worlds.update()
    assert [info.name for info in memory.worlds()] == ["base", "belief_1", "belief_2"]
    taken, gone = memory.world("belief_1"), memory.world("belief_2")
    assert taken.node("world")["weight"] == pytest.approx(0.225) and taken.node("world")["things"] == "ball"
    assert taken.transform("world", "ball", types=("Virtual_RT",)).t == THERE.t
    assert taken.get_edge("hand_0", "ball", "grasping") is not None and taken.get_edge("ball", "cup", "in") is None
    assert gone.get_edge("world", "ball", "Virtual_RT") is None and gone.node("ball")["present"] is False
    assert memory.get_edge("ball", "cup", "in") is not None
    assert memory.transform("world", "ball", types=("Virtual_RT",)) == HERE
    worlds.close()
    assert [info.name for info in memory.worlds()] == ["base"]


def test_worlds_are_written_on_change_only_and_removed_when_no_longer_believed(memory: Memory) -> None:
    tell(memory, spread())
    worlds = BeliefWorlds(memory, most=3)
    worlds.update()
    before = {name: memory.world(name).snapshot() for name in ("belief_1", "belief_2")}
    worlds.update()
    tell(memory, spread(0.71))
    worlds.update()
    assert {name: memory.world(name).snapshot() for name in before} == before
    tell(memory, spread(0.4))
    worlds.update()
    assert memory.world("belief_1").node("world")["weight"] == pytest.approx(0.45)
    tell(memory, spread(0.9))
    worlds.update()
    assert [info.name for info in memory.worlds()] == ["base", "belief_1"]
    memory.update_node("ball", **{ATTRIBUTE: ""})
    worlds.update()
    assert [info.name for info in memory.worlds()] == ["base"]


def test_worlds_are_no_more_than_asked_for_and_take_over_those_of_an_earlier_run(memory: Memory) -> None:
    tell(memory, spread(0.4))
    BeliefWorlds(memory, most=3).update()
    later = BeliefWorlds(memory, most=1)
    later.update()
    assert [info.name for info in memory.worlds()] == ["base", "belief_1"]
    assert [round(world.weight, 2) for world in leading(memory, 5)] == [0.45, 0.15]
    assert math.isclose(memory.world("belief_1").node("world")["weight"], 0.45)


def test_things_of_one_island_are_otherwise_together(memory: Memory) -> None:
    memory.add_edge("world", "cup", "Virtual_RT", pose=HERE)
    for name in ("ball", "cup"):
        alternatives = (
            Alternative(weight=0.6, pose=HERE),
            Alternative(weight=0.4, pose=THERE, reason="shoved", worlds=(1,)),
        )
        tell(memory, Whereabouts(name, alternatives, ("ball", "cup"), (0.6, 0.4)))
    (only,) = leading(memory, 5)
    assert sorted(only.things) == ["ball", "cup"] and only.weight == pytest.approx(0.4)


def test_read_by_hand(memory: Memory) -> None:
    assert whereabouts_of(memory.node("cup"), None) is None
