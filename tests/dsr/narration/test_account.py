"""Sentences about a graph: what is seen is told as it is, all else is marked, and each has its evidence."""

from __future__ import annotations

import msgspec
import pytest

from dsr import ConfigError, Memory, Pose
from dsr.narration import Basis, Moment, StatedClaim, Statement, Subject, account, chapters, check_names
from dsr.narration.statements import ago, length_of_time
from dsr.timeline import Chronicle
from dsr.vocabulary.calibration import CONFIRMED, SURPRISE, Report, pose_of, request_calibration
from dsr.vocabulary.halting import HaltOrder, write_order
from tests.dsr.narration.conftest import NOW, put


def told(moment: Moment, name: str, subject: Subject = Subject.PLACE) -> Statement:
    """The one statement on a subject whose first name this is."""
    found = [one for one in account(moment) if one.names[:1] == (name,) and one.subject is subject]
    assert len(found) == 1, found
    return found[0]


def test_what_is_seen_is_told_without_a_mark(moment: Moment) -> None:
    cup = told(moment, "cup")
    assert cup.text == "cup rests on table, at x 0.30 m, y 0.09 m." and cup.basis is Basis.PERCEIVED
    assert cup.claims == (StatedClaim("on", ("cup", "table")), StatedClaim("at", ("cup",), (0.3, 0.09, 0.05)))
    assert cup.evidence["relations"] == [
        {"relation": "on", "of": "cup", "to": "table", "source": "contact", "since": NOW - 50.0}
    ]


def test_what_is_unseen_is_believed_and_the_sentence_says_why(moment: Moment) -> None:
    cube = told(moment, "cube_4")
    assert cube.text == (
        "cube_4 is believed to rest on table, at x 0.30 m, y -0.20 m: unseen for 12.5 s, cube_3 hides it from camera, "
        "the robot concluded that cube_3 moved, and cube_4 beneath it moved along."
    )
    assert cube.basis is Basis.BELIEVED and cube.evidence["seconds_unseen"] == 12.5


def test_a_seen_thing_on_an_unseen_one_is_only_believed_to_be_there(moment: Moment) -> None:
    assert told(moment, "cube_3").text == "cube_3 is believed to rest on cube_4: cube_4 is unseen."


def test_a_thing_in_another_does_not_rest_on_it_too(moment: Moment) -> None:
    ball = told(moment, "ball")
    assert ball.text == "ball is believed to be in box: unseen for 3 min 20 s, out of the sight of camera."
    assert ball.claims == (StatedClaim("in", ("ball", "box")),)


def test_what_is_gone_and_what_is_nowhere(moment: Moment) -> None:
    gone = told(moment, "cube_9")
    assert gone.text == "cube_9 is believed to be gone: the robot concluded that cube_9 was taken away."
    assert gone.claims == (StatedClaim("gone", ("cube_9",)),) and gone.basis is Basis.BELIEVED
    assert told(moment, "cube_10").text == "Nobody knows where cube_10 is."


def test_what_surprises_is_believed_only(memory: Memory) -> None:
    memory.update_node("cup", surprising=True, surprise="seen 60 mm beside its belief")
    moment = Moment.of(memory)
    assert told(moment, "cup").basis is Basis.BELIEVED
    assert told(moment, "cup", Subject.SURPRISE).text == "cup surprises the robot: seen 60 mm beside its belief."


def test_what_a_camera_sees_that_may_have_moved_is_believed(memory: Memory) -> None:
    memory.add_edge("camera", "cup", "RT", pose=Pose((0.0, 0.0, 1.0), stamp=NOW))
    memory.update_node("camera", mount="in doubt")
    assert told(Moment.of(memory), "cup").text == (
        "cup is believed to rest on table, at x 0.30 m, y 0.09 m: camera may have moved."
    )
    memory.update_node("camera", mount="steady")
    assert told(Moment.of(memory), "cup").basis is Basis.PERCEIVED


def test_what_a_camera_sees_whose_new_pose_may_be_taken_back_is_believed(memory: Memory) -> None:
    """Also for the seconds in which its mount is told to be confirmed, so that beliefs follow."""
    pose = (0.3, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0)
    report = Report("camera", "world", "robust", True, "why", pose, pose, (), 0.1, 0.0, 9.0, False, 1, 4, 4, ())
    memory.add_edge("camera", "cup", "RT", pose=Pose((0.001, 0.0949, -0.45), stamp=NOW))
    memory.add_edge("world", "camera", "RT", pose=pose_of(pose))
    name = request_calibration(memory, "camera")
    for is_provisional, basis in ((True, Basis.BELIEVED), (False, Basis.PERCEIVED)):
        answer = msgspec.structs.replace(report, provisional=is_provisional)
        memory.update_node(name, source=SURPRISE, report=msgspec.json.encode(answer).decode())
        memory.update_node("camera", mount=CONFIRMED)
        assert told(Moment.of(memory), "cup").basis is basis


def test_an_old_flag_of_being_seen_does_not_count(memory: Memory) -> None:
    """Whoever wrote it may have died."""
    assert told(Moment(memory, NOW + 20.0), "cup").text.startswith("cup is believed to rest on table")


def test_grippers_feel_what_they_hold_and_hands_only_seem_to(memory: Memory) -> None:
    memory.add_node("gripper", "gripper")
    assert told(Moment.of(memory), "gripper", Subject.HOLDING).claims == (StatedClaim("empty", ("gripper",)),)
    memory.add_edge("gripper", "ball", "grasping", source="gripper", since=NOW)
    memory.add_node("hand", "hand", perceived=True, last_seen=NOW)
    memory.add_edge("hand", "cup", "grasping", source="contact", handling="touching", since=NOW)
    moment = Moment.of(memory)
    assert told(moment, "gripper", Subject.HOLDING).text == "gripper holds ball."
    hand = told(moment, "hand", Subject.HOLDING)
    assert hand.text == "hand is believed to touch cup." and hand.claims == (StatedClaim("touching", ("hand", "cup")),)
    memory.remove_edge("cup", "table", "on")
    memory.add_edge("hand", "cup", "grasping", handling="pinching")
    assert told(Moment.of(memory), "cup").text == "cup is believed to be held by hand."
    assert told(Moment.of(memory), "hand", Subject.HOLDING).text == "hand is believed to hold cup."


def test_persons_are_there_and_see_or_are_not_there(memory: Memory) -> None:
    memory.add_node("sally", "person", perceived=True, last_seen=NOW)
    memory.add_node("anne", "person", perceived=False, last_seen=NOW - 5.0)
    memory.add_edge("sally", "cup", "sees", visible=True, share=0.9)
    memory.add_edge("sally", "ball", "sees", visible=False, share=0.0)
    moment = Moment.of(memory)
    assert told(moment, "sally", Subject.SIGHT).text == "sally is believed to see cup."
    assert told(moment, "anne", Subject.SIGHT).text == "anne is not there, last seen 5.0 s ago."


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"status": "waiting", "explanation": "never seen: cup"}, "The robot waits with that: never seen: cup."),
        ({"status": "executing", "explanation": "action 1 of 2: pick cube_3", "replans": 1},
         "The robot acts for that: action 1 of 2: pick cube_3. It has planned again once."),
        ({"status": "planning", "replans": 2}, "The robot makes a plan for that. It has planned again 2 times."),
        ({"status": "reached"}, "The robot believes that this goal is reached."),
        ({"status": "failed", "explanation": "it fell"}, "The robot has given this goal up (failed): it fell."),
        ({}, "The robot has not begun with that (wanted)."),
    ],
)  # fmt: skip
def test_what_the_robot_wants_and_why_it_waits(memory: Memory, values: dict[str, object], sentence: str) -> None:
    memory.add_node("intention_0", "intention", goal="on(cube_3, cup) & clear(cube_3)", maintain=True, **values)
    wanted = [one.text for one in account(Moment.of(memory)) if one.subject is Subject.WANTED]
    assert wanted == ["The robot wants cube_3 on cup and nothing on cube_3, and wants it to stay so.", sentence]


def test_that_motion_is_forbidden_comes_first(memory: Memory) -> None:
    write_order(memory, HaltOrder("1", True, "ann", "somebody is near", NOW))
    told_of = [one for one in account(Moment.of(memory)) if one.subject is Subject.FORBIDDEN]
    assert [one.text for one in told_of] == ["Motion is forbidden: halted by ann: somebody is near."]


def test_events_are_told_by_when_they_were_seen(memory: Memory) -> None:
    chronicle = Chronicle(memory, "chronicler")
    memory.clock.advance(10.0)  # type: ignore[attr-defined]
    memory.update_node("cup", last_seen=NOW + 10.0)
    chronicle.happened("Pick", ("cup", "unknown"), NOW + 6.0, confidence=0.7)
    chronicle.happened("Place", ("cube_4", "hand"), NOW + 7.0, confidence=0.95)
    chronicle.end(chronicle.begin("on", ("cup", "table"), NOW + 2.0, source="contact"), NOW + 8.0)
    chronicle.begin("on", ("cube_4", "table"), NOW + 3.0, source="contact")
    chronicle.begin("grasping", ("gripper", "cube_3"), NOW + 5.0, source="gripper")
    chronicle.begin("grasping", ("hand", "cup"), NOW + 5.5, source="contact")
    chronicle.begin("agent", ("planner", "planner-1"), NOW + 5.0)
    chronicle.happened("Spill", "cup", NOW + 9.0, text="wet")
    found = [one for one in account(Moment.of(memory), since=NOW + 1.0) if one.subject is Subject.HAPPENED]
    assert [one.text for one in found] == [
        "8.0 s ago, cup came to rest on table.",
        "7.0 s ago, it is believed, cube_4 came to rest on table.",
        "5.0 s ago, gripper took hold of cube_3.",
        "4.5 s ago, it is believed, hand touched cup.",
        "4.0 s ago, probably (0.70), somebody picked cup up.",
        "Between 22.5 s ago and 3.0 s ago, unseen, probably (0.95), hand put cube_4 down.",
        "2.0 s ago, cup stopped resting on table.",
        '1.0 s ago, chronicler told: "wet".',
    ]
    assert found[0].evidence["kind"] == "on" and found[4].confidence == 0.7 and found[6].time == NOW + 8.0


def test_conclusions_and_goals_are_told_as_those_of_the_robot(memory: Memory) -> None:
    chronicle = Chronicle(memory, "chronicler")
    goal = {"goal": "on(a, b)", "status": "waiting", "explanation": "never seen: a"}
    chronicle.happened("intention", "intention_0", NOW - 2.0, **goal)
    action = {"skill": "place", "target": "a", "destination": "b", "status": "failed", "explanation": "it slipped"}
    chronicle.happened("action", "action_0_0,a,b", NOW - 1.0, **action)
    found = [one for one in account(Moment.of(memory), since=NOW - 5.0) if one.subject is Subject.HAPPENED]
    assert {one.basis for one in found} == {Basis.OWN}
    assert [one.text for one in found] == [
        "4.0 s ago, the robot concluded that cube_9 was taken away.",
        "4.0 s ago, the robot concluded that cube_3 moved, and cube_4 beneath it moved along.",
        "2.0 s ago, the robot waited with the goal a on b: never seen: a.",
        "1.0 s ago, the robot failed: place a on b: it slipped.",
    ]


def test_only_what_is_about_a_name(moment: Moment) -> None:
    assert {name for one in account(moment, about=["box"]) for name in one.names} == {"ball", "box", "table"}
    with pytest.raises(ConfigError, match="there is no 'bxo'; did you mean 'box'"):
        account(moment, about=["bxo"])
    check_names(moment, ["cup", "table"])


def test_chapters_keep_all_statements_in_order(moment: Moment) -> None:
    statements = account(moment)
    parts = chapters(statements)
    assert [title for title, _ in parts][:1] == ["Where things are"]
    assert [one for _, some in parts for one in some] == statements


def test_an_empty_graph_has_nothing_to_tell() -> None:
    from tests.dsr.narration.conftest import make_memory

    assert account(Moment.of(make_memory())) == []


def test_a_thing_in_the_air_is_told_with_its_height(memory: Memory) -> None:
    put(memory, "kite", (0.1, 0.2, 0.9), "box", perceived=True, last_seen=NOW)
    assert told(Moment.of(memory), "kite").text == (
        "kite is believed to be at x 0.10 m, y 0.20 m, z 0.90 m: nothing is known to hold it there."
    )
    memory.add_edge("camera", "kite", "RT", pose=Pose((0.0, 0.0, 1.0), stamp=NOW, covariance=[[4e-6] * 6] * 6))
    percept = told(Moment.of(memory), "kite").evidence["percept"]
    assert percept == {"from": "camera", "stamp": NOW, "position_deviation_m": pytest.approx(2e-3)}


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.04, "0.0 s"), (59.9, "59.9 s"), (180.0, "3 min"), (185.2, "3 min 5 s"), (7800.0, "2 h 10 min")],
)
def test_lengths_of_time(seconds: float, words: str) -> None:
    assert length_of_time(seconds) == words and ago(seconds) == f"{words} ago"


@pytest.mark.parametrize(("height", "is_perceived"), [(0.065, True), (0.08, False)])
def test_what_is_seen_elsewhere_is_only_believed(memory: Memory, height: float, is_perceived: bool) -> None:
    memory.update_node("cube_3", last_seen=NOW)
    memory.update_node("cube_4", perceived=True, last_seen=NOW)
    memory.add_edge("world", "cube_3", "RT", pose=Pose((0.3, -0.2, height)))  # believed at a height of 0.06 m
    (told,) = (one for one in account(Moment.of(memory)) if one.names[0] == "cube_3" and one.subject is Subject.PLACE)
    assert (told.basis is Basis.PERCEIVED) is is_perceived
    assert ("it is seen 2 cm from there" in told.text) is not is_perceived
