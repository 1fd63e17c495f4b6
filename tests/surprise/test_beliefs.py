"""Beliefs with their recent past."""

from __future__ import annotations

import pytest

from benchmarks.surprise_scene import SIX, SurpriseScene
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from surprise.beliefs import Beliefs


@pytest.fixture
def scene() -> SurpriseScene:
    return SurpriseScene({"cube_0": SIX["cube_0"]})


def believe(scene: SurpriseScene, x: float, stamp: float) -> None:
    scene.memory.add_edge("world", "cube_0", "Virtual_RT", pose=Pose((x, 0.0, 0.0), stamp=stamp))


def test_a_belief_on_its_way_is_interpolated_and_one_that_rested_is_not(scene: SurpriseScene) -> None:
    beliefs, node = Beliefs(scene.memory, 1.0, PoseTolerance(0.005, 0.1)), scene.memory.node("cube_0")
    for x, stamp in ((0.0, 10.0), (0.1, 10.1), (0.5, 11.1)):
        believe(scene, x, stamp)
        beliefs.update(stamp, [node], set())
    for stamp, x in ((9.0, 0.0), (10.05, 0.05), (10.9, 0.1), (11.1, 0.5), (12.0, 0.5)):
        found = beliefs.at("cube_0", stamp)
        assert found is not None
        assert found.t[0] == pytest.approx(x)
    assert beliefs.at("cube_1", 10.0) is None


def test_a_belief_jumps_unless_it_is_carried(scene: SurpriseScene) -> None:
    beliefs, node = Beliefs(scene.memory, 1.0, PoseTolerance(0.005, 0.1)), scene.memory.node("cube_0")
    found = []
    for x, held in ((0.0, False), (0.004, False), (0.02, False), (0.05, True)):
        believe(scene, x, 10.0 + x)
        found.append(beliefs.update(10.0 + x, [node], {"cube_0"} if held else set()))
    assert found == [set(), set(), {"cube_0"}, set()]
    scene.memory.remove_edge("world", "cube_0", "Virtual_RT")
    assert beliefs.update(11.0, [node], set()) == set()
    assert beliefs.now("cube_0") is None


def test_how_a_thing_was_believed_before_is_not_from_before_a_jump(scene: SurpriseScene) -> None:
    beliefs, node = Beliefs(scene.memory, 1.0, PoseTolerance(0.005, 0.1)), scene.memory.node("cube_0")
    assert beliefs.before("cube_0", 10.0) is None
    for x, stamp in ((0.0, 10.0), (0.001, 11.0), (0.1, 12.0), (0.101, 13.0)):
        believe(scene, x, stamp)
        beliefs.update(stamp, [node], set())
        if stamp == 11.0:
            assert [beliefs.before("cube_0", at).t[0] for at in (9.0, 11.0, 11.5)] == [0.0, 0.0, 0.001]  # type: ignore[union-attr]
    assert beliefs.since("cube_0") == 12.0
    assert [beliefs.before("cube_0", at).t[0] for at in (10.5, 12.5, 14.0)] == [0.1, 0.1, 0.101]  # type: ignore[union-attr]
