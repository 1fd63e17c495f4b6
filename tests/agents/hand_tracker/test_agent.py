"""The hand tracker as others see it: hands come, are followed, leave and are forgotten, whatever the cameras send."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.plant.camera import OVERHEAD
from agents.plant.messages import hands_key
from agents.plant.reality import Reality
from agents.scenario.format.scenario import HandEnter, ObjectSpec
from dsr import Frame, Pose
from dsr.errors import AgentError
from dsr.network.keys import Keys
from dsr.network.transport import Qos

from .conftest import FLAT_HAND, Bench, in_world, palm_of, reading, tips_of

PALM, TIPS = in_world(palm_of(FLAT_HAND)[None])[0], in_world(tips_of(FLAT_HAND))
AWAY = (0.15, 0.0, 0.0)
NAME = "human_hand_0"


def finger(number: int, hand: str = NAME) -> str:
    return f"{hand}_finger_{number}"


def test_a_hand_becomes_nodes_with_poses_in_the_world(bench: Bench) -> None:
    stamp = bench.clock.now()
    bench.tell(reading())
    node = bench.memory.node(NAME)
    assert (node.type, node["side"], node["source"], node["perceived"]) == ("hand", "right", "poses", True)
    assert node["last_seen"] == stamp
    assert bench.place(NAME) == pytest.approx(PALM, abs=1e-3)
    for number in range(5):
        assert bench.memory.get_edge(NAME, finger(number), "has") is not None
        assert bench.memory.node(finger(number)).type == "finger" and bench.memory.node(finger(number))["perceived"]
        assert bench.place(finger(number)) == pytest.approx(TIPS[number], abs=1e-3)
    pose = bench.memory.edge("world", NAME, "RT").pose
    assert pose.stamp == stamp and pose.covariance is not None
    towards = pose.rotation_matrix
    assert towards[:, 0] @ (TIPS[2] - PALM) / np.linalg.norm(TIPS[2] - PALM) > 0.95
    assert towards[2, 2] > 0.9  # its back is up


def test_only_fingertips_that_are_seen_exist(bench: Bench) -> None:
    bench.tell(reading(hidden=(4, 20)))
    assert finger(0) not in bench.memory and finger(4) not in bench.memory
    assert bench.memory.node(finger(1))["perceived"]


def test_a_hidden_fingertip_goes_with_the_palm_for_a_while(make_bench: Callable[..., Bench], bench: Bench) -> None:
    bench.tell(reading(), ticks=3)
    bench.tell(reading((0.05, 0.0, 0.0), hidden=(8,)), ticks=15)
    assert bench.memory.node(finger(1))["perceived"] is False
    expected = in_world(tips_of(FLAT_HAND)[1:2] + np.array([0.05, 0.0, 0.0]))[0]
    assert bench.place(finger(1)) == pytest.approx(expected, abs=2e-3)
    bench.tell(reading((0.05, 0.0, 0.0), hidden=(8,)), ticks=30)
    assert finger(1) not in bench.memory and finger(2) in bench.memory


def test_what_leaves_is_not_perceived_and_later_forgotten(bench: Bench) -> None:
    bench.tell(reading(), ticks=3)
    bench.tell(ticks=8)
    assert bench.hands() == [NAME]
    bench.tell(ticks=4)
    assert bench.hands() == [] and bench.memory.node(finger(1))["perceived"] is False
    assert bench.place(NAME) == pytest.approx(PALM, abs=1e-3)
    bench.run(29.0)
    assert NAME in bench.memory
    bench.run(1.0)
    assert NAME not in bench.memory and bench.memory.nodes("finger") == []


def test_a_hand_that_grasps_is_not_forgotten(bench: Bench) -> None:
    bench.memory.add_node("cup_1", "cup")
    bench.tell(reading(), ticks=3)
    bench.memory.add_edge(NAME, "cup_1", "grasping", source="contact")
    bench.run(35.0)
    assert NAME in bench.memory and finger(1) in bench.memory
    bench.memory.remove_edge(NAME, "cup_1", "grasping")
    bench.run(0.2)
    assert NAME not in bench.memory


def test_a_hand_that_comes_back_is_the_same_hand(bench: Bench) -> None:
    bench.tell(reading(), ticks=3)
    bench.tell(ticks=60)
    bench.tell(reading(AWAY))
    assert bench.hands() == [NAME]
    assert bench.place(NAME) == pytest.approx(in_world(palm_of(FLAT_HAND + AWAY)[None])[0], abs=1e-3)


def test_a_left_hand_after_a_right_one_is_another(bench: Bench) -> None:
    bench.tell(reading(), ticks=3)
    bench.tell(ticks=20)
    bench.tell(reading(side="left"))
    assert bench.hands() == ["human_hand_1"] and bench.memory.node(NAME)["perceived"] is False


@pytest.mark.parametrize(("side", "name"), [("right", NAME), ("left", "human_hand_1"), ("unknown", NAME)])
def test_numbers_go_by_side(bench: Bench, side: str, name: str) -> None:
    bench.tell(reading(side=side))
    assert bench.hands() == [name]


def test_two_hands_keep_their_names_when_they_pass_each_other(bench: Bench) -> None:
    for step in range(21):
        x = -0.15 + 0.015 * step
        bench.tell(reading((x, -0.08, 0.0), "unknown"), reading((-x, 0.08, 0.0), "unknown"))
    assert bench.hands() == [NAME, "human_hand_1"]
    ends = {name: bench.place(name)[1] for name in bench.hands()}
    begun_left = in_world(palm_of(FLAT_HAND + np.array([0.15, -0.08, 0.0]))[None])[0][1]
    assert ends[NAME] == pytest.approx(begun_left, abs=0.02)


def test_a_third_hand_is_ignored(bench: Bench) -> None:
    bench.tell(reading((-0.2, 0.0, 0.0)), reading((0.2, 0.0, 0.0), "left"), reading((0.0, 0.2, 0.0)), ticks=3)
    assert len(bench.hands()) == 2


def test_a_restarted_tracker_goes_on_with_the_hands_and_forgets_old_ones(bench: Bench) -> None:
    bench.tell(reading(), reading((0.2, 0.0, 0.0), "left"), ticks=3)
    bench.stop()
    bench.start()
    bench.tell(reading((0.01, 0.0, 0.0)), ticks=12)
    assert bench.hands() == [NAME]
    bench.tell(reading(), ticks=620)
    assert "human_hand_1" not in bench.memory and bench.hands() == [NAME]


def test_a_camera_whose_place_is_unknown_and_nonsense_are_skipped(bench: Bench) -> None:
    key = hands_key(Keys("test"), "overhead")
    bench.memory.transport.publish(key, b"\xc1nonsense", Qos.STREAM)
    bench.run(0.1)
    bench.memory.remove_edge("world", "camera_overhead", "RT")
    bench.tell(reading(), ticks=2)
    assert bench.hands() == [] and bench.agent.skipped["camera not placed"] == 2


def test_what_a_moving_camera_shows_is_not_used(bench: Bench) -> None:
    def place_camera(x: float) -> None:
        pose = Pose(OVERHEAD.translation + np.array([x, 0.0, 0.0]), OVERHEAD.rotation, bench.clock.now())
        bench.memory.add_edge("world", "camera_overhead", "RT", pose=pose)

    for _ in range(4):
        place_camera(0.0)
        bench.tell(reading())
    seen = bench.memory.node(NAME)["last_seen"]
    bench.agent.skipped.clear()
    for step in range(1, 6):
        place_camera(0.01 * step)
        bench.tell(reading())
    assert bench.memory.node(NAME)["last_seen"] == seen and bench.agent.skipped["camera moved"] == 5
    for _ in range(6):
        place_camera(0.05)
        bench.tell(reading())
    assert bench.memory.node(NAME)["last_seen"] > seen
    expected = in_world(palm_of(FLAT_HAND)[None])[0] + np.array([0.05, 0.0, 0.0])
    assert np.linalg.norm(bench.place(NAME) - expected) < 0.02


@pytest.mark.parametrize(
    "arrays",
    [{}, {"color": np.zeros((4, 4), np.uint8)}, {"color": np.zeros((4, 4, 3), np.uint8)}],
    ids=["nothing", "grey", "no depth"],
)
def test_frames_that_cannot_be_used_are_counted(make_bench: Callable[..., Bench], arrays: dict[str, Any]) -> None:
    bench = make_bench()
    bench.show(Frame(0.0, arrays, {"fx": 600.0, "fy": 600.0, "cx": 2.0, "cy": 2.0}), ticks=2)
    assert bench.agent.skipped["malformed"] == 2


def test_rendered_hands_are_written_without_a_model_which_is_no_fault(
    make_bench: Callable[..., Bench], make_reality: Callable[..., Reality]
) -> None:
    events = [HandEnter(at=0.0, position=(0.40, 0.10, 0.10)), HandEnter(at=0.0, hand=1, position=(0.40, -0.12, 0.10))]
    cube = ObjectSpec(name="cube_3", marker_id=3, position=(0.25, 0.0, 0.02))
    reality = make_reality(2.0, events=events, objects=[cube])
    bench = make_bench(finder="colour")
    for _ in range(3):
        bench.show(reality.frame(0.0))
    truth = [np.array(points) for points in reality.truth(0.0).hands.values()]
    assert len(bench.hands()) == 2 and bench.agent.degraded == ""
    assert bench.memory.node(NAME)["source"] == "skin colour" and bench.memory.node(NAME)["side"] == "unknown"
    for name in bench.hands():
        near = min(truth, key=lambda points: float(np.linalg.norm(palm_of(points) - bench.place(name))))
        assert np.linalg.norm(palm_of(near) - bench.place(name)) < 0.02
        fingers = [edge.dst for edge in bench.memory.edges("has", src=name)]
        assert len(fingers) >= 4
        for node in fingers:
            assert np.linalg.norm(tips_of(near) - bench.place(node), axis=1).min() < 0.012


def test_only_the_tracker_writes_fingers_and_surprise_may_write_hands() -> None:
    from agents.hand_tracker import HandTracker
    from dsr.agent import Access
    from dsr.errors import ConfigError
    from dsr.graph.access import check_writers
    from surprise.agent import SurpriseDetector

    check_writers({"hand_tracker": HandTracker.writes, "surprise": SurpriseDetector.writes})
    assert "hand" in SurpriseDetector.writes.nodes
    assert not SurpriseDetector.writes.includes("finger")
    with pytest.raises(ConfigError, match="hand_tracker"):
        check_writers({"hand_tracker": HandTracker.writes, "other": Access(nodes=("finger",))})
    with pytest.raises(AgentError):
        Access(nodes=("hand",), exclusive=("finger",))


def test_the_system_with_hands_is_the_usual_one_and_the_tracker() -> None:
    usual, hands = (
        tomllib.loads(Path(f"etc/systems/{name}.toml").read_text(encoding="utf-8"))["agent"]
        for name in ("tabletop", "hands")
    )
    assert [agent for agent in hands if agent["name"] != "hand_tracker"] == usual
    assert len(hands) == len(usual) + 1


def test_a_hand_that_was_seen_at_a_time_to_come_does_not_stay_for_ever(bench: Bench) -> None:
    for name, kind in ((NAME, "hand"), (finger(1), "finger")):
        bench.memory.add_node(name, kind, perceived=True, last_seen=1e12)
        bench.memory.add_edge("world", name, "RT", pose=Pose())
    bench.memory.add_edge(NAME, finger(1), "has")
    bench.run(0.5)
    assert NAME not in bench.memory and finger(1) not in bench.memory


def test_a_hand_that_is_nowhere_is_not_adopted(bench: Bench) -> None:
    """Its edge without a pose made each tick fail, and so ended the tracker at each start."""
    bench.memory.add_node(NAME, "hand", perceived=True)
    bench.memory.add_edge("world", NAME, "RT")
    bench.exchange(0.1)
    assert NAME in bench.own and bench.agent._nodes.known() == []
