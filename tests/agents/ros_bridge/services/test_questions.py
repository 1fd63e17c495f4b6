"""The memory's questions as services, asked by a node of ROS."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.errors import RosLinkError
from agents.ros_bridge.mapping.stamps import to_time
from agents.ros_bridge.mapping.transforms import read_pose_with_covariance
from agents.ros_bridge.messages.definitions import SERVICES
from dsr import Pose
from dsr.files.built_in import ETC
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.intentions import add_intention
from dsr.vocabulary.what_if import Answer, decode_question, encode_answer
from simulation_handler import SimulationHandler
from tests.agents.ros_bridge.robot import TYPES, Bridged, bridged

ASK, TRANSFORM, TRIGGER = "dsr_msgs/srv/Ask", "dsr_msgs/srv/Transform", "std_srvs/srv/Trigger"
CUBE = Pose((0.3, 0.1, 0.02), (0.0, 0.0, 0.6, 0.8), covariance=np.diag([4e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]))


@pytest.fixture
def system() -> Iterator[Bridged]:
    with bridged({"world_frame": "map"}) as found:
        memory = found.memory
        memory.add_node("world", "world")
        memory.add_node("table", "table")
        memory.add_node("camera", "camera")
        memory.add_node("cube_1", "cube", size=(0.04, 0.04, 0.04), perceived=True)
        memory.add_edge("world", "camera", "RT", pose=Pose((0.0, 0.0, 1.0)))
        memory.add_edge("camera", "cube_1", "RT", pose=Pose((0.0, 0.0, -0.9), stamp=found.now))
        memory.add_edge("world", "cube_1", "Virtual_RT", pose=CUBE.with_stamp(found.now))
        memory.add_edge("cube_1", "table", "on")
        found.run()
        yield found


def ask(system: Bridged, name: str, type: str, **fields: Any) -> Any:
    request = TYPES.encode(f"{type}_Request", TYPES.new(f"{type}_Request", **fields))
    return TYPES.decode(f"{type}_Response", system.robot.link.call(f"/dsr/{name}", type, request, 1.0))


def test_where_are_the_objects(system: Bridged) -> None:
    response = ask(system, "objects", TRIGGER)
    assert response.success
    cube, table = json.loads(response.message)
    assert (cube["name"], cube["type"], cube["on"], cube["perceived"]) == ("cube_1", "cube", ["table"], True)
    assert cube["position"] == [0.3, 0.1, 0.02] and table["position"] is None


def test_objects_are_looked_up_ten_times_a_second_however_often_they_are_asked_for(system: Bridged) -> None:
    first = ask(system, "objects", TRIGGER).message
    system.memory.add_node("cube_2", "cube")
    system.run(0.04)
    assert ask(system, "objects", TRIGGER).message == first
    system.run(0.1)
    assert [one["name"] for one in json.loads(ask(system, "objects", TRIGGER).message)][:2] == ["cube_1", "cube_2"]


def test_where_is_a_frame_in_another_one(system: Bridged) -> None:
    response = ask(system, "transform", TRANSFORM, target="map", source="cube_1")
    assert response.success and response.pose.header.frame_id == "map"
    assert read_pose_with_covariance(response.pose.pose, 0.0).t == pytest.approx((0.0, 0.0, 0.1))
    believed = ask(system, "transform", TRANSFORM, target="/map", source="belief/cube_1")
    found = read_pose_with_covariance(believed.pose.pose, 0.0)
    assert found.distance(CUBE) == pytest.approx((0.0, 0.0), abs=1e-9)
    np.testing.assert_allclose(found.covariance, CUBE.covariance, atol=1e-12)
    began = system.memory.edge("camera", "cube_1", "RT")["pose"].stamp
    system.memory.add_edge("camera", "cube_1", "RT", pose=Pose((0.0, 0.0, -0.8), stamp=began + 0.1))
    system.run()
    then = ask(system, "transform", TRANSFORM, target="map", source="cube_1", stamp=to_time(TYPES, began + 0.05))
    assert then.pose.pose.pose.position.z == pytest.approx(0.15), "half way between two samples"


@pytest.mark.parametrize(("target", "source"), [("map", "nowhere"), ("", "cube_1"), ("map", "table")])
def test_a_transform_that_is_not_known_has_a_reason(system: Bridged, target: str, source: str) -> None:
    response = ask(system, "transform", TRANSFORM, target=target, source=source)
    assert not response.success and response.message


QUESTION = '{"seconds": 0.5, "changes": [{"object": "cube_1", "action": "remove"}]}'


def ask_meanwhile(system: Bridged, question: str) -> Any:
    """Ask from a thread of its own, as a node elsewhere does, while the run goes on."""
    found: list[Any] = []
    thread = threading.Thread(target=lambda: found.append(ask(system, "what_if", ASK, question=question)))
    thread.start()
    for _ in range(600):
        system.run(0.1)
        thread.join(0.01)
        if not thread.is_alive():
            break
    (response,) = found
    return response


def test_what_if_questions_are_answered_in_lockstep(system: Bridged) -> None:
    asked = []

    def answer(key: str, payload: bytes) -> bytes:
        asked.append(decode_question(payload))
        return encode_answer(Answer(stamp=1.0, seconds=0.5, at_rest=True, poses={"cube_1": (0.0,) * 6 + (1.0,)}))

    system.lockstep.bus.serve(system.lockstep.keys.service("what_if"), answer)
    response = ask_meanwhile(system, QUESTION)
    assert asked[0].changes[0].action == "remove"
    assert response.success, response.answer
    assert json.loads(response.answer)["at_rest"] is True


def test_the_simulation_handler_answers_in_lockstep() -> None:
    """What would become of a cube in the air: it falls onto the table."""
    handler = AgentSpec("simulation_handler", SimulationHandler, {})
    with bridged({}, [handler]) as system:
        memory = system.memory
        memory.add_node("world", "world")
        memory.add_node("table", "table", size=(1.0, 1.0, 0.04))
        memory.add_edge("world", "table", "RT", pose=Pose((0.0, 0.0, 0.0)))  # of its top
        memory.add_node("cube_1", "cube", size=(0.04, 0.04, 0.04), perceived=True)
        for _ in range(20):
            memory.add_edge("world", "cube_1", "RT", pose=Pose((0.0, 0.0, 0.02), stamp=system.now))
            system.run(0.1)
        moved = {"object": "cube_1", "action": "place", "pose": [0.1, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]}
        response = ask_meanwhile(system, json.dumps({"seconds": 2.0, "changes": [moved]}))
        assert response.success, response.answer
        found = json.loads(response.answer)
        assert found["rests_on"]["cube_1"] == ["table"] and found["poses"]["cube_1"][2] == pytest.approx(0.02, abs=2e-3)


def test_a_what_if_question_without_an_answer_has_a_reason(system: Bridged) -> None:
    silent = ask_meanwhile(system, QUESTION)
    assert not silent.success and "does the simulation handler run" in silent.answer
    own = ask(system, "what_if", ASK, question=QUESTION)
    assert not own.success and "waits for itself" in own.answer


@pytest.mark.parametrize("question", ["", "{", "[]", '{"seconds": -1}', '{"seconds": 99}', "x" * 2_000_000])
def test_a_malformed_what_if_question_has_a_reason(system: Bridged, question: str) -> None:
    response = ask(system, "what_if", ASK, question=question)
    assert not response.success and 0 < len(response.answer) < 1000


def test_a_goal_becomes_an_intention(system: Bridged) -> None:
    response = ask(system, "mission", ASK, question="on(cube_1,table)")
    told = json.loads(response.answer)
    assert response.success and "no agent 'planner' runs" in told["note"]
    system.run()
    assert system.memory.node(told["intention"])["goal"] == "on(cube_1,table)"
    wrong = ask(system, "mission", ASK, question="on(cube_1,nowhere)")
    assert not wrong.success and "there is no 'nowhere'" in wrong.answer
    assert not ask(system, "mission", ASK, question="fly(cube_1)").success


def test_a_flood_of_missions_is_refused(system: Bridged) -> None:
    for _ in range(100):
        assert ask(system, "mission", ASK, question="on(cube_1,table)").success
    refused = ask(system, "mission", ASK, question="on(cube_1,table)")
    assert not refused.success and "100 missions are not at their end" in refused.answer
    system.run()
    system.memory.update_node("intention_7", status="reached")
    system.run()
    assert ask(system, "mission", ASK, question="on(cube_1,table)").success
    system.run()
    assert len(system.memory.nodes("intention")) == 101


KEEP = 3.0


@pytest.fixture
def brief() -> Iterator[Bridged]:
    """Whose missions are removed soon after their end."""
    with bridged({"send": {"keep_missions": KEEP}}) as found:
        found.memory.add_node("cube_1", "cube")
        found.memory.add_node("table", "table")
        found.run()
        yield found


def mission(system: Bridged) -> str:
    name = json.loads(ask(system, "mission", ASK, question="on(cube_1,table)").answer)["intention"]
    system.run()
    assert isinstance(name, str)
    return name


def test_missions_stay_ten_minutes_after_their_end() -> None:
    assert Send().keep_missions == 600.0


@pytest.mark.parametrize("status", ["reached", "failed", "invalid", "unsolvable", "no_solver"])
def test_a_mission_that_ended_is_removed_after_a_while_and_no_other_one(brief: Bridged, status: str) -> None:
    asked = [mission(brief) for _ in range(3)]
    own = add_intention(brief.memory, "on(cube_1,table)")
    for name in (asked[0], own):
        brief.memory.update_node(name, status=status)
    brief.memory.update_node(asked[2], status="maintained")
    brief.run(KEEP - 0.5)
    assert len(brief.memory.nodes("intention")) == 4
    brief.run(2.5)
    assert {node.name for node in brief.memory.nodes("intention")} == {asked[1], asked[2], own}
    assert brief.counts["missions removed"] == 1


def test_a_mission_that_is_tried_again_is_not_over(brief: Bridged) -> None:
    name = mission(brief)
    for status, seconds in (("failed", KEEP - 1.0), ("executing", 1.5), ("failed", KEEP - 1.0)):
        brief.memory.update_node(name, status=status)
        brief.run(seconds)
    assert name in brief.memory
    brief.run(3.0)
    assert name not in brief.memory


def test_a_mission_of_an_earlier_life_is_removed(brief: Bridged) -> None:
    name = mission(brief)
    brief.memory.update_node(name, status="failed")
    brief.run()
    brief.lockstep.kill("ros_bridge")
    brief.lockstep.restart("ros_bridge")
    brief.run(KEEP + 2.0)
    assert name not in brief.memory


def test_a_goal_that_is_a_book_is_refused(system: Bridged) -> None:
    long = ask(system, "mission", ASK, question=" and ".join(["on(cube_1,table)"] * 5000))
    assert not long.success and "a question of 104995 characters" in long.answer


@settings(max_examples=50)
@given(st.binary(max_size=100))
def test_any_bytes_get_an_answer_or_are_refused(request: bytes) -> None:
    with bridged() as system:
        for name, type in (("transform", TRANSFORM), ("mission", ASK), ("what_if", ASK), ("objects", TRIGGER)):
            try:
                cdr = system.robot.link.call(f"/dsr/{name}", type, request, 1.0)
            except RosLinkError:
                continue
            TYPES.decode(f"{type}_Response", cdr)
        assert not system.memory.nodes("intention") or b"(" in request


@pytest.mark.parametrize("name", [name for name in SERVICES if name.startswith("dsr_msgs/")])
def test_our_definitions_are_those_that_users_build(name: str) -> None:
    package, _, type = name.split("/")
    folder = ETC / "ros" / package
    text = (folder / "srv" / f"{type}.srv").read_text(encoding="utf-8")
    plain = re.sub(r"[ \t]*#.*", "", text)
    parts = tuple("; ".join(filter(None, part.splitlines())) for part in plain.split("---"))
    assert parts == SERVICES[name]
    assert f'"srv/{type}.srv"' in (folder / "CMakeLists.txt").read_text(encoding="utf-8")
