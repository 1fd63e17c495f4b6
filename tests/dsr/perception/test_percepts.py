"""Percepts that are new, and why others are not given."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.surprise_scene import CAMERA, SIX, SurpriseScene
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.percepts import PerceptReader
from dsr.perception.scales import RECENT_PERCEPTS
from dsr.vocabulary.perceived import MOST_AHEAD


@pytest.fixture
def scene() -> SurpriseScene:
    return SurpriseScene({"cube_0": SIX["cube_0"]})


def see(scene: SurpriseScene, stamp: float, camera: str = CAMERA) -> None:
    scene.memory.add_edge(camera, "cube_0", "RT", pose=Pose((0.0, 0.0, 0.6), (1.0, 0.0, 0.0, 0.0), stamp))


def test_a_percept_is_given_once_in_the_world_frame(scene: SurpriseScene) -> None:
    percepts = PerceptReader(scene.memory)
    scene.memory.add_edge(CAMERA, "cube_0", "RT", pose=Pose((0.0, 0.0, 0.6), (1.0, 0.0, 0.0, 0.0), 10.0))
    (percept,) = percepts.new(10.05, {"cube_0"})
    assert (percept.camera, percept.name, percept.stamp) == (CAMERA, "cube_0", 10.0)
    assert percept.pose.t == pytest.approx((0.35, 0.0, 0.05))
    assert percept.eye == pytest.approx((0.35, 0.0, 0.65))
    assert percepts.new(10.1, {"cube_0"}) == []


def test_a_percept_waits_for_the_pose_of_a_camera_that_moves(scene: SurpriseScene) -> None:
    percepts, memory = PerceptReader(scene.memory), scene.memory
    for stamp in (9.0, 9.5):
        memory.add_edge("world", CAMERA, "RT", pose=Pose((stamp, 0.0, 0.6), stamp=stamp))
    memory.add_edge(CAMERA, "cube_0", "RT", pose=Pose((0.0, 0.0, 0.6), stamp=10.0))
    assert percepts.new(10.05, {"cube_0"}) == []
    memory.add_edge("world", CAMERA, "RT", pose=Pose((10.5, 0.0, 0.6), stamp=10.5))
    (percept,) = percepts.new(10.5, {"cube_0"})
    assert percept.eye[0] == pytest.approx(10.0)
    assert percepts.skipped == {"camera's place not known then": 1}


def test_an_older_percept_is_not_given_after_a_newer_one(scene: SurpriseScene) -> None:
    percepts = PerceptReader(scene.memory)
    given = []
    for stamp in (10.0, 9.9, 10.1):
        see(scene, stamp)
        given += [percept.stamp for percept in percepts.new(10.2, {"cube_0"})]
    assert given == [10.0, 10.1]


def test_what_is_too_old_or_ahead_of_the_clock_is_counted(scene: SurpriseScene) -> None:
    percepts = PerceptReader(scene.memory, oldest=1.0)
    see(scene, 8.9)
    assert percepts.new(10.0, {"cube_0"}) == percepts.new(10.0, {"cube_0"}) == []
    assert percepts.skipped == {"too old": 1}
    see(scene, 10.1 + MOST_AHEAD)
    assert percepts.new(10.0, {"cube_0"}) == []
    assert percepts.skipped == {"too old": 1, "from the future": 1}
    assert percepts.problems["cube_0"] == f"percept of 'cube_0' from '{CAMERA}' is stamped 0.6 s ahead"
    (percept,) = percepts.new(10.3, {"cube_0"})
    assert percept.stamp == 10.1 + MOST_AHEAD


def test_a_percept_that_holds_at_all_times_is_one_of_each_look(scene: SurpriseScene) -> None:
    see(scene, 0.0)
    percepts = PerceptReader(scene.memory)
    assert [percept.stamp for now in (10.0, 10.1) for percept in percepts.new(now, {"cube_0"})] == [10.0, 10.1]
    assert PerceptReader(scene.memory, timeless=False).new(10.0, {"cube_0"}) == []


def test_only_the_things_and_cameras_asked_for_are_given(scene: SurpriseScene) -> None:
    see(scene, 10.0)
    percepts = PerceptReader(scene.memory)
    assert percepts.new(10.0, {"cube_1"}) == []
    assert percepts.new(10.0, {"cube_0"}, {"another_camera"}) == []
    assert len(percepts.new(10.0, {"cube_0"}, {CAMERA})) == 1


@pytest.mark.parametrize("far", [101.0, 1e8, 1e12])
@pytest.mark.parametrize("what", ["camera", "thing"])
def test_what_is_beyond_all_rooms_is_no_percept(scene: SurpriseScene, far: float, what: str) -> None:
    percepts = PerceptReader(scene.memory)
    if what == "camera":
        scene.memory.add_edge("world", CAMERA, "RT", pose=Pose((far, 0.0, 0.6)))
        see(scene, 10.0)
    else:
        scene.memory.add_edge(CAMERA, "cube_0", "RT", pose=Pose((far, 0.0, 0.6), stamp=10.0))
    for now in (10.05, 10.1):
        assert percepts.new(now, {"cube_0"}) == []
    assert percepts.skipped == {"too far": 1} and percepts.problems == {}
    scene.memory.add_edge("world", CAMERA, "RT", pose=Pose((0.35, 0.0, 0.65)))
    see(scene, 10.2)
    assert len(percepts.new(10.25, {"cube_0"})) == 1


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """How often memories are asked for transforms: what they are asked for."""
    asked: list[object] = []
    transform = Memory.transform

    def noted(memory: Memory, *of: Any, **more: Any) -> Pose:
        asked.append(of)
        return transform(memory, *of, **more)

    monkeypatch.setattr(Memory, "transform", noted)
    return asked


def see_all(scene: SurpriseScene, stamp: float) -> None:
    for name in SIX:
        scene.memory.add_edge(CAMERA, name, "RT", pose=Pose((0.0, 0.0, 0.6), (1.0, 0.0, 0.0, 0.0), stamp))


def test_where_a_camera_was_is_asked_once_for_all_that_an_image_shows(asked: list[object]) -> None:
    scene = SurpriseScene(SIX)
    see_all(scene, 10.0)
    assert len(PerceptReader(scene.memory).new(10.05, set(SIX))) == len(SIX)
    assert len(asked) == 1


def test_that_nobody_knows_where_a_camera_was_is_told_once(asked: list[object]) -> None:
    scene = SurpriseScene(SIX)
    for stamp in (8.0, 9.0):
        scene.memory.add_edge("world", CAMERA, "RT", pose=Pose((0.0, 0.0, 0.6), stamp=stamp))
    see_all(scene, 10.0)
    percepts = PerceptReader(scene.memory)
    assert percepts.new(10.05, set(SIX)) == []
    assert percepts.skipped == {"camera's place not known then": len(SIX)}
    assert len(asked) == 1


def test_who_looks_seldom_gets_the_percepts_in_between_in_the_order_of_their_stamps(scene: SurpriseScene) -> None:
    scene.memory.add_node("other", "camera")
    scene.memory.add_edge("world", "other", "RT", pose=Pose((0.35, 0.0, 0.65)))
    percepts = PerceptReader(scene.memory)
    see(scene, 10.0)
    see(scene, 10.05, "other")
    assert [percept.stamp for percept in percepts.new(10.1, {"cube_0"})] == [10.0, 10.05]
    for stamp in (10.1, 10.2, 10.3):
        see(scene, stamp)
        see(scene, stamp + 0.05, "other")
    found = percepts.new(10.4, {"cube_0"})
    assert [percept.stamp for percept in found] == pytest.approx([10.1, 10.15, 10.2, 10.25, 10.3, 10.35])
    assert [percept.camera for percept in found] == [CAMERA, "other"] * 3
    assert percepts.new(10.5, {"cube_0"}) == []


def test_of_what_was_seen_before_the_first_look_the_newest_is_given(scene: SurpriseScene) -> None:
    for stamp in (10.0, 10.1, 10.2):
        see(scene, stamp)
    assert [percept.stamp for percept in PerceptReader(scene.memory).new(10.3, {"cube_0"})] == [10.2]


def test_of_what_was_not_asked_for_at_the_last_look_the_newest_is_given(scene: SurpriseScene) -> None:
    """Who leaves out a thing that is held wants nothing of the time in the hand later."""
    percepts = PerceptReader(scene.memory)
    see(scene, 10.0)
    percepts.new(10.0, {"cube_0"})
    for stamp in (10.1, 10.2):
        see(scene, stamp)
        assert percepts.new(stamp, ()) == []
    see(scene, 10.3)
    assert [percept.stamp for percept in percepts.new(10.3, {"cube_0"})] == [10.3]


def test_what_is_too_old_in_between_is_no_problem(scene: SurpriseScene) -> None:
    percepts = PerceptReader(scene.memory, oldest=0.5)
    see(scene, 10.0)
    percepts.new(10.0, {"cube_0"})
    for stamp in (10.1, 10.2, 11.0):
        see(scene, stamp)
    assert [percept.stamp for percept in percepts.new(11.1, {"cube_0"})] == [11.0]
    assert percepts.problems == {} and not percepts.skipped


def test_of_very_many_percepts_the_newest_are_given(scene: SurpriseScene) -> None:
    percepts = PerceptReader(scene.memory)
    see(scene, 10.0)
    percepts.new(10.0, {"cube_0"})
    for count in range(1, 101):
        see(scene, 10.0 + 0.001 * count)
    found = [percept.stamp for percept in percepts.new(10.2, {"cube_0"})]
    assert len(found) == RECENT_PERCEPTS and found[-1] == pytest.approx(10.1)
