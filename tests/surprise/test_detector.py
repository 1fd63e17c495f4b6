"""The surprise detector on a synthetic scene: what raises a flag, what does not, what clears it."""

from __future__ import annotations

import logging
import math

import pytest

from benchmarks.surprise_scene import CAMERA, PERIOD, SIX, SurpriseScene, moved, upright
from dsr.clock import ManualClock
from dsr.crdt.delta import Add, Delta
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.replication.wire import encode_delta
from dsr.vocabulary.bodies import MOST_BODIES


def test_a_static_noisy_scene_raises_no_alarm() -> None:
    scene = SurpriseScene(SIX, seed=1)
    scene.run(60.0)
    assert scene.events == []
    assert [scene.memory.node(name)["surprising"] for name in SIX] == [False] * 6


@pytest.mark.parametrize("seed", range(12))
def test_a_move_of_15_mm_is_noticed_within_half_a_second(seed: int) -> None:
    scene = SurpriseScene(SIX, seed)
    scene.run(2.0 + PERIOD * (seed % 2))
    name = f"cube_{seed % 6}"
    scene.truths[name] = moved(scene.truths[name], 0.015, 0.7 * seed)
    took = scene.run_until_surprising(name, 1.0)
    assert took is not None
    assert took <= 0.5
    assert "mm beside its belief" in scene.why(name)
    assert [node for _, node, _, _ in scene.events] == [name]


def test_a_belief_that_percepts_make_unsure_is_surprised_by_them_as_before() -> None:
    scene = SurpriseScene(SIX, seed=5)
    scene.run(2.0)
    begin = scene.truths["cube_2"]
    for frame in range(1, 6):  # it slides by 10 mm a frame
        scene.truths["cube_2"] = moved(begin, 0.01 * frame, 1.0)
        scene.run(0.1)
        scene.unsure["cube_2"] = 0.011  # from the first frame that contradicts the belief on
    assert scene.is_surprising("cube_2")
    scene.run(3.0)
    assert scene.is_surprising("cube_2"), "the belief still has it elsewhere, surer than that when the motion began"


def test_what_an_unsure_belief_allowed_for_before_is_no_surprise() -> None:
    scene = SurpriseScene(SIX, seed=5)
    scene.unsure["cube_2"] = 0.011
    scene.run(3.0)
    scene.truths["cube_2"] = moved(scene.truths["cube_2"], 0.02, 1.0)
    assert scene.run_until_surprising("cube_2", 3.0) is None


def test_a_turn_in_place_is_noticed() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.truths["cube_2"] = moved(scene.truths["cube_2"], 0.0, 0.0, math.radians(45))
    took = scene.run_until_surprising("cube_2", 1.0)
    assert took is not None
    assert took <= 0.5
    assert "turned by 45 deg" in scene.why("cube_2")


def test_a_change_of_height_is_noticed_in_spite_of_the_depth_bias() -> None:
    for height in (0.04, -0.04):
        scene = SurpriseScene({"cube_0": SIX["cube_0"], "cube_1": SIX["cube_1"]}, seed=4)
        scene.run(3.0)
        x, y, z = scene.truths["cube_0"].t
        scene.truths["cube_0"] = Pose((x, y, z + height), scene.truths["cube_0"].q)
        took = scene.run_until_surprising("cube_0", 1.0)
        assert took is not None
        assert took <= 0.5


def test_one_or_two_false_frames_never_alarm() -> None:
    scene = SurpriseScene(SIX, seed=2)
    scene.run(1.0)
    for frame in range(100):
        pose = scene.truths["cube_1"]
        far = Pose((0.4, 0.0, 0.3), pose.q) if frame % 2 else moved(pose, 0.05, frame, 1.0)
        for _ in range(1 + frame % 2):
            scene.false["cube_1"] = far
            scene.run(0.1)
        scene.run(0.5)
    assert scene.events == []


def test_errors_in_all_directions_are_not_a_move() -> None:
    scene = SurpriseScene(SIX, seed=3)
    scene.run(1.0)
    for frame in range(50):
        scene.false["cube_1"] = moved(scene.truths["cube_1"], 0.03, 2.4 * frame)
        scene.run(0.1)
    assert scene.events == []


def test_the_flag_goes_when_the_belief_follows() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.truths["cube_3"] = moved(scene.truths["cube_3"], 0.05, 1.0)
    scene.run(1.0)
    assert scene.is_surprising("cube_3")
    scene.beliefs["cube_3"] = scene.truths["cube_3"]
    scene.run(0.1)
    assert not scene.is_surprising("cube_3")
    assert scene.why("cube_3") == ""
    scene.run(2.0)
    assert len(scene.events) == 2


def test_a_wrong_belief_stays_surprising_and_says_by_how_much() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.truths["cube_3"] = moved(scene.truths["cube_3"], 0.05, 1.0)
    scene.run(1.0)
    scene.beliefs["cube_3"] = moved(scene.truths["cube_3"], 0.10, 1.0)
    scene.run(2.0)
    assert scene.is_surprising("cube_3")
    assert float(scene.why("cube_3").split()[1]) == pytest.approx(100, abs=5)


def test_a_belief_on_its_way_is_compared_at_the_time_of_the_percept() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.memory.add_node("gripper", "gripper")
    scene.memory.add_edge("gripper", "cube_0", "grasping", since=0.0)
    for _ in range(30):
        scene.truths["cube_0"] = scene.beliefs["cube_0"] = moved(scene.truths["cube_0"], 0.01, 0.5)
        scene.tick()
    assert scene.events == []


def test_what_is_held_is_judged_later() -> None:
    scene = SurpriseScene(SIX)
    scene.memory.add_node("gripper", "gripper")
    scene.memory.add_edge("gripper", "cube_0", "grasping", since=0.0)
    scene.run(2.0)
    scene.truths["cube_0"] = moved(scene.truths["cube_0"], 0.05, 1.0)
    took = scene.run_until_surprising("cube_0", 2.0)
    assert took is not None
    assert 0.5 < took < 1.0
    scene.beliefs["cube_0"] = scene.truths["cube_0"]
    scene.hidden.add("cube_0")
    scene.run(5.0)
    assert not scene.is_surprising("cube_0"), "nobody expects to see what the gripper covers"


def test_what_should_be_seen_and_is_not() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.hidden.add("cube_4")
    took = scene.run_until_surprising("cube_4", 2.0)
    assert took is not None
    assert 0.4 < took < 0.8
    assert scene.why("cube_4") == f"should be seen by {CAMERA}, and is not"
    scene.memory.add_edge(CAMERA, "cube_4", "sees", detectable=0.4, covered_by="cube_1")
    scene.run(0.6)
    assert not scene.is_surprising("cube_4")
    assert [node for _, node, _, _ in scene.events] == ["cube_4", "cube_4"]


def test_what_cannot_be_seen_and_is() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.memory.add_edge(CAMERA, "cube_4", "sees", detectable=0.0, covered_by="cube_1")
    took = scene.run_until_surprising("cube_4", 2.0)
    assert took is not None
    assert 0.4 < took < 1.0
    assert scene.why("cube_4") == f"seen by {CAMERA}, though cube_1 should hide it"
    scene.memory.add_edge(CAMERA, "cube_4", "sees", detectable=1.0, covered_by="")
    scene.run(0.2)
    assert not scene.is_surprising("cube_4")


def test_the_boxes_of_the_arm_are_only_rough() -> None:
    scene = SurpriseScene(SIX)
    scene.memory.add_node("link", "body")
    scene.memory.add_edge(CAMERA, "cube_4", "sees", detectable=0.0, covered_by="link")
    scene.run(3.0)
    assert scene.events == []


def test_a_camera_that_sees_nothing_is_itself_surprising() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.hidden.update(SIX)
    took = scene.run_until_surprising(CAMERA, 2.0)
    assert took is not None
    assert 1.4 < took < 1.8
    assert scene.why(CAMERA).startswith("sees nothing; expected cube_0, cube_1,")
    scene.run(5.0)
    scene.hidden.clear()
    scene.run(1.0)
    assert [(node, flag) for _, node, flag, _ in scene.events] == [(CAMERA, True), (CAMERA, False)]


def test_nothing_is_expected_of_a_moving_camera_or_without_objects() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.hidden.update(SIX)
    pose = scene.memory.edge("world", CAMERA, "RT").pose
    for step in range(100):
        place = (pose.t[0] + 0.002 * step, pose.t[1], pose.t[2])
        scene.memory.add_edge("world", CAMERA, "RT", pose=Pose(place, pose.q))
        scene.tick()
    assert scene.events == []
    for name in SIX:
        scene.memory.remove_edge(CAMERA, name, "sees")
    scene.run(3.0)
    assert scene.events == []


def test_what_is_believed_gone_and_is_seen_again() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.hidden.add("cube_5")
    scene.run(1.5)
    assert scene.is_surprising("cube_5")
    del scene.beliefs["cube_5"]
    scene.memory.remove_edge("world", "cube_5", "Virtual_RT")
    scene.memory.remove_edge(CAMERA, "cube_5", "sees")
    scene.memory.update_node("cube_5", present=False)
    scene.run(0.1)
    assert not scene.is_surprising("cube_5"), "being gone explains it"
    scene.run(2.0)
    scene.hidden.clear()
    assert scene.run_until_surprising("cube_5", 1.0) is not None
    assert scene.why("cube_5") == "seen, though believed gone"
    scene.memory.update_node("cube_5", present=True)
    scene.beliefs["cube_5"] = scene.truths["cube_5"]
    scene.run(0.5)
    assert not scene.is_surprising("cube_5")


def test_a_restart_goes_on_from_the_graph() -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.truths["cube_3"] = moved(scene.truths["cube_3"], 0.05, 1.0)
    scene.run(1.0)
    text = scene.why("cube_3")
    scene.start_detector()
    scene.tick()
    assert scene.is_surprising("cube_3")
    assert scene.why("cube_3") == text
    scene.beliefs["cube_3"] = scene.truths["cube_3"]
    scene.run(1.0)
    assert [flag for _, _, flag, _ in scene.events] == [True, False]


@pytest.mark.parametrize("jump", [-600.0, -1.0, 30.0])
def test_a_clock_that_jumps_raises_nothing(jump: float, caplog: pytest.LogCaptureFixture) -> None:
    scene = SurpriseScene(SIX)
    scene.run(2.0)
    scene.clock = scene.memory.clock = ManualClock(scene.clock.now() + jump)
    with caplog.at_level(logging.WARNING):
        scene.run(3.0)
    assert scene.events == []
    assert ("set back" in caplog.text) == (jump < 0)


def test_it_survives_what_is_missing_or_wrong() -> None:
    scene = SurpriseScene({"cube_0": SIX["cube_0"], "cube_1": SIX["cube_1"]})
    memory, now = scene.memory, scene.clock.now()
    memory.add_node("cube_x", "cube", surprise="left over", surprising=True)
    memory.add_node("ball_1", "ball")
    memory.add_node("camera_lost", "camera")
    memory.add_edge("world", "ball_1", "Virtual_RT", pose=Pose((0.3, 0.0, 0.02)))
    indefinite = [[0.0] * 6 for _ in range(6)]
    indefinite[0][1] = indefinite[1][0] = 1e-3
    huge = [[1e12 * (row == column) for column in range(6)] for row in range(6)]
    for stamp, covariance in ((now, indefinite), (now + 0.01, huge), (now + 100.0, None), (0.0, None), (1.0, None)):
        for camera in (CAMERA, "camera_lost"):
            pose = Pose((0.0, 0.0, 0.6), (1.0, 0.0, 0.0, 0.0), stamp, covariance)
            memory.add_edge(camera, "ball_1", "RT", pose=pose)
        memory.add_edge(camera, "ball_1", "sees", detectable=1.0)
        scene.run(0.3)
    assert set(scene.detector.skipped) == {"too old", "from the future", "no chain to the world"}
    assert not scene.is_surprising("cube_x"), "nothing is believed of it"
    for name in ("cube_0", "world", CAMERA):
        scene.truths.pop(name, None)
        scene.beliefs.pop(name, None)
        memory.remove_node(name)
        scene.detector.tick(scene.clock.now())


def test_however_many_things_somebody_makes_up_few_are_looked_at_and_those_of_others_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 3000, each look took longer than the time until the next one."""
    scene, looks = SurpriseScene({"cube_0": SIX["cube_0"]}), list[set[str]]()
    beliefs, synchroniser = scene.detector._beliefs, scene.memory.replica.synchroniser
    update, liar = beliefs.update, "liar-1"

    def counted(now: float, objects: list[Node], moving: set[str]) -> set[str]:
        looks.append({node.name for node in objects})
        return update(now, objects, moving)

    monkeypatch.setattr(beliefs, "update", counted)
    adds = [Add((liar, number + 1), f"a_{number}", "cube") for number in range(MOST_BODIES + 9)]
    made = Delta(adds, context=[(liar, 1, len(adds))])
    synchroniser.receive_delta(liar, encode_delta(made), scene.clock.now())
    scene.run(0.2)
    assert scene.detector.degraded == f"10 things are passed over: {MOST_BODIES} others are looked at"
    assert len(looks[-1]) == MOST_BODIES and "cube_0" in looks[-1]
    gone = Delta(removed=[add.dot for add in adds], context=[(liar, len(adds) + 1, len(adds) + 1)])
    synchroniser.receive_delta(liar, encode_delta(gone), scene.clock.now())
    scene.run(0.2)
    assert scene.detector.degraded == "" and looks[-1] == {"cube_0"}


def test_a_new_object_is_not_surprising() -> None:
    scene = SurpriseScene({"cube_0": SIX["cube_0"]})
    scene.run(1.0)
    scene.memory.add_node("cube_9", "cube", size=(0.04,) * 3)
    scene.run(1.0)
    assert "surprising" not in scene.memory.node("cube_9")
    scene.truths["cube_9"] = scene.beliefs["cube_9"] = upright(0.3, 0.0, 0.0)
    scene._bias["cube_9"] = 0.01
    scene.run(1.0)
    assert scene.memory.node("cube_9")["surprising"] is False
    assert scene.events == []
