"""Answers about sides of things, about several things at once, and about whether things stayed where they were."""

from __future__ import annotations

import pytest

from dsr import ManualClock, Memory, Pose
from dsr.narration import Moment
from dsr.narration.answer import Response
from dsr.narration.answers import answer_alone
from dsr.timeline import Chronicle
from dsr.vocabulary.calibration import CALIBRATED
from tests.dsr.narration.conftest import NOW, make_memory, put


@pytest.fixture
def room(memory: Memory) -> Moment:
    """The table as sally sees it from the left (along x); the second camera, a hand with fingers, the cup moved."""
    memory.add_node("sally", "person", perceived=True, last_seen=NOW)
    memory.add_edge("world", "sally", "RT", pose=Pose((-1.0, 0.0, 0.5)))
    memory.add_node("camera_2", "camera")
    memory.add_node("hand_0", "hand", perceived=True, last_seen=NOW)
    memory.add_node("hand_0_finger_1", "finger")
    memory.add_edge("world", "hand_0", "RT", pose=Pose((0.8, 0.0, 0.1)))
    memory.add_edge("sally", "cup", "sees", visible=True, share=1.0)
    chronicle = Chronicle(memory, "chronicler")
    chronicle.happened("Pick", ("cup", "hand_0"), NOW - 20.0, confidence=0.9)
    chronicle.happened("Place", ("cup", "hand_0"), NOW - 18.0, confidence=0.8)
    chronicle.happened("Release", ("ball", "hand_0"), NOW - 41.0, confidence=0.9)
    chronicle.happened(CALIBRATED, ("camera", "cube_3"), NOW - 9.0, text="camera is elsewhere")
    chronicle.end(chronicle.begin("in", ("ball", "cup"), NOW - 55.0, source="contact"), NOW - 50.0)
    chronicle.begin("in", ("ball", "box"), NOW - 40.0, source="contact")
    return Moment(memory, NOW, NOW - 60.0)


def ask(moment: Moment, question: str) -> Response:
    response = answer_alone(moment, question, "nobody simulates")
    assert response.understood, response.text
    return response


@pytest.mark.parametrize(
    ("question", "names"),
    [
        ("what is behind the cup, seen from sally", ()),
        ("what is behind cube_3 as seen from sally", ()),
        ("what is left of the cup from sally's point of view", ()),
        ("what is to the right of the cup, seen from sally", ("ball", "box", "cube_3", "cube_4")),
        ("which cubes are right of the cup from sally", ("cube_3", "cube_4")),
        ("which box is the ball in", ("box",)),
        ("which cubes are hidden", ("cube_10", "cube_4")),
        ("what was picked up last", ("cup",)),
        ("what did the hand pick up", ("cup",)),
        ("what was the last thing the hand dropped", ("ball",)),
        ("where are the cup and the ball", ("table", "box")),
        ("who put the ball in the box", ("hand_0",)),
    ],
)
def test_answers_that_are_names(room: Moment, question: str, names: tuple[str, ...]) -> None:
    assert ask(room, question).names == names, ask(room, question).text


@pytest.mark.parametrize(
    ("question", "verdict"),
    [
        ("is anybody behind the box, seen from sally", True),
        ("is anybody in front of the box, seen from sally", False),
        ("is anything behind the box, seen from sally", False),
        ("is cube_3 right of the cup from sally", True),
        ("is the hand behind the box from sally", True),
        ("are the cup and the box on the table", True),
        ("are the cup and the ball on the table", False),
        ("is any of the cubes on the table", True),
        ("are all the cubes on the table", False),
        ("has the ball ever been in the cup", True),
        ("has the cup ever been in the box", False),
        ("has the camera moved", True),
        ("did cube_3 move", True),
        ("is the cup where it was", False),
        ("is the box where it was", True),
        ("is the ball where it was 52 s ago", False),
        ("is the hand empty", True),
        ("is the box empty", False),
        ("is the cup empty", True),
        ("can anybody see the cup", True),
        ("can anybody see the ball", False),
        ("is anything missing", True),
        ("is anything hidden", True),
        ("did the hand put the cup down", True),
        ("did the hand put the ball down", False),
    ],
)
def test_answers_that_are_yes_or_no(room: Moment, question: str, verdict: bool) -> None:
    response = ask(room, question)
    assert response.verdict is verdict and response.text.startswith("Yes" if verdict else "No"), response.text


def test_an_act_that_nobody_saw_has_a_stretch_of_time(room: Moment) -> None:
    seen, unseen = ask(room, "when was the cup put down"), ask(room, "when did the hand drop the ball")
    assert (seen.since, seen.time) == (None, NOW - 18.0)
    assert (unseen.since, unseen.time) == (NOW - 200.0, NOW - 41.0)
    assert "unseen" in unseen.text and "unseen" not in seen.text


def test_what_hides_a_thing_may_be_unknown(room: Moment) -> None:
    room.memory.add_edge("camera_2", "cube_10", "sees", visible=True, share=1.0)
    room.memory.add_edge("hand_0", "cube_10", "grasping", source="contact", since=NOW - 5.0)
    response = ask(room, "why is cube_10 hidden")
    assert "something that the robot does not know hides it. hand_0 took it out of sight" in response.text


def test_why_something_is_no_longer_so_and_for_how_long_it_is(room: Moment) -> None:
    gone = ask(room, "how come the ball isn't in the cup any more")
    assert "50.0 s ago, it is believed, ball came out of cup" in gone.text, gone.text
    assert "But that is so" in ask(room, "why is the ball not in the box").text
    assert ask(room, "how long has the ball been there").time == NOW - 40.0
    assert "0.22 m apart" in ask(room, "how far is the cup from the box").text
    assert "put cup down" in ask(room, "what did the hand do with the cup").text


def test_poses_tell_whether_a_thing_was_moved_unseen() -> None:
    memory = make_memory()
    memory.add_node("world", "world")
    put(memory, "cup", (0.3, 0.0, 0.05), "cup", perceived=False, last_seen=NOW - 60.0)
    clock = memory.clock
    assert isinstance(clock, ManualClock)
    for step in range(10):
        clock.advance(0.5)
        memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((0.3 + 0.02 * step, 0.0, 0.05), stamp=clock.now()))
    moment = Moment.of(memory)
    assert ask(moment, "is the cup where it was 4 s ago").verdict is False
    assert ask(moment, "is the cup where it was 0.6 s ago").verdict is True
    assert "m from where it was" in ask(moment, "is the cup still where it used to be").text
