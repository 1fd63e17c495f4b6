"""Answers from a graph: each with its evidence, its basis and what programs need; and what has no answer."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from dsr import Memory, Pose
from dsr.narration import Basis, Moment
from dsr.narration.answer import Response
from dsr.narration.answers import answer, answer_alone, example_questions
from dsr.timeline import Chronicle
from dsr.vocabulary.what_if import Answer, Question, Supposed
from tests.dsr.narration.conftest import NOW


@pytest.fixture
def kitchen(memory: Memory) -> Moment:
    """The table with things, a gripper, two persons of whom one has a world, and a past."""
    memory.add_node("gripper", "gripper")
    memory.add_edge("world", "gripper", "RT", pose=Pose((0.1, 0.2, 0.5)))
    memory.add_node("sally", "person", perceived=True, last_seen=NOW)
    memory.add_node("anne", "person", perceived=False, last_seen=NOW - 5.0)
    memory.add_edge("sally", "cup", "sees", visible=True, share=0.75, hidden_by="box")
    memory.add_edge("sally", "ball", "sees", visible=False, share=0.0, hidden_by="cup")
    memory.add_edge("gripper", "cube_3", "grasping", source="gripper", since=NOW - 1.0)
    chronicle = Chronicle(memory, "chronicler")
    chronicle.end(chronicle.begin("on", ("ball", "table"), NOW - 50.0, source="contact"), NOW - 41.0)
    chronicle.begin("in", ("ball", "box"), NOW - 40.0, source="contact")
    chronicle.end(chronicle.begin("grasping", ("hand", "ball"), NOW - 45.0, source="contact"), NOW - 40.0)
    chronicle.happened("Pick", ("ball", "hand"), NOW - 44.0, confidence=0.9)
    chronicle.happened("Place", ("cup", "unknown"), NOW - 20.0, confidence=0.8)
    world = memory.create_world("view_of_sally")
    world.add_node("world", "world")
    for name, kind in (("cup", "cup"), ("ball", "ball")):
        world.add_node(name, kind, perceived=False, present=True, last_seen=NOW - 31.0)
        world.add_edge("world", name, "RT", pose=Pose((0.3, 0.09, 0.05)))
    world.add_edge("ball", "cup", "in")
    return Moment(memory, NOW, NOW - 60.0)


def ask(moment: Moment, question: str) -> Response:
    return answer_alone(moment, question, "nobody simulates")


@pytest.mark.parametrize(
    ("question", "names"),
    [
        ("where is the cup?", ("table",)),
        ("where is the ball", ("box",)),
        ("where was the ball 45 s ago?", ("table", "hand")),
        ("where was the ball at 30 s?", ("box",)),
        ("where does sally think the ball is?", ("cup",)),
        ("what is on the table?", ("box", "cube_4", "cup")),
        ("what is under cube_3", ("cube_4",)),
        ("what was on the table 45 s ago", ("ball",)),
        ("what does sally think is in the cup", ("ball",)),
        ("who sees the cup", ("sally",)),
        ("what does sally see", ("cup",)),
        ("what does the robot see", ("box", "cube_3", "cup")),
        ("what hides cube_4", ("cube_3",)),
        ("who holds cube_3", ("gripper",)),
        ("who held the ball 42 s ago", ("hand",)),
        ("what do you hold", ("cube_3",)),
        ("who picked the ball up", ("hand",)),
        ("who moved the cup", ()),
        ("which things are there", ("ball", "box", "cube_10", "cube_3", "cube_4", "cup")),
        ("how many cubes are there", ("cube_10", "cube_3", "cube_4")),
        ("why can sally not see the ball", ("cup",)),
        ("Tell me where the cup is.", ("table",)),
        ("any idea where the ball went?", ("box",)),
        ("whereabouts is the ball", ("box",)),
        ("which box holds the ball?", ("box",)),
        ("what does the box contain?", ("ball",)),
        ("what is the thing on the table", ("box", "cube_4", "cup")),
        ("what holds cube_3", ("gripper",)),
        ("which cubes can you see", ("cube_3",)),
        ("how many things can sally see", ("cup",)),
        ("list all cubes", ("cube_10", "cube_3", "cube_4")),
        ("what objects do you know?", ("ball", "box", "cube_10", "cube_3", "cube_4", "cup")),
    ],
)
def test_answers_that_are_names(kitchen: Moment, question: str, names: tuple[str, ...]) -> None:
    response = ask(kitchen, question)
    assert response.understood and response.names == names, response.text


@pytest.mark.parametrize(
    ("question", "verdict"),
    [
        ("is the cup on the table", True),
        ("is the ball on the table", False),
        ("was the ball on the table 45 s ago", True),
        ("is cube_4 under cube_3", True),
        ("is cube_3 above cube_4", True),
        ("does sally believe that the ball is in the cup", True),
        ("does sally know where the ball is", False),
        ("is sally wrong about the ball", True),
        ("is there a kettle", False),
        ("is there a ball", True),
        ("is anne there", False),
        ("is cube_9 gone", True),
        ("is the cup visible", True),
        ("is the ball visible to sally", False),
        ("does sally see the cup", True),
        ("can anne see the cup", False),
        ("is the gripper holding cube_3", True),
        ("is the robot holding the cup", False),
        ("does the box contain the ball?", True),
        ("does the box contain the cup?", False),
    ],
)
def test_answers_that_are_yes_or_no(kitchen: Moment, question: str, verdict: bool) -> None:
    response = ask(kitchen, question)
    assert response.verdict is verdict and response.text.startswith("Yes" if verdict else "No"), response.text


@pytest.mark.parametrize(
    ("question", "time"),
    [
        ("when was the ball picked up", NOW - 44.0), ("when was cube_4 last seen", NOW - 12.5),
        ("how long has the ball been unseen", NOW - 200.0), ("since when is the ball in the box", NOW - 40.0),
        ("when did sally last see the ball", NOW - 31.0), ("when did cube_3 move", NOW - 4.0),
        ("when did you last see cube_4", NOW - 12.5), ("how long ago did you see cube_4", NOW - 12.5),
        ("when was the ball last picked up", NOW - 44.0), ("how long ago was the ball picked up", NOW - 44.0),
        ("when did the ball fall", None), ("how long has the cup been in the box", None),
    ],
)  # fmt: skip
def test_answers_that_are_times(kitchen: Moment, question: str, time: float | None) -> None:
    assert ask(kitchen, question).time == time


@pytest.mark.parametrize(
    ("question", "words"),
    [
        ("why is cube_3 on cube_4", "the two touch in the simulation of physics for 50.0 s"),
        ("why did cube_3 move", "the robot concluded that cube_3 moved, and cube_4 beneath it moved along"),
        ("why is cube_9 gone", "cube_9 was taken away"),
        ("why is cube_3 in the box", "That is not so."),
        ("why is the cup surprising", "cup is not surprising now."),
        ("what happened to the ball", "probably (0.90), hand picked ball up"),
        ("what happened in the last 10 s", "the robot concluded that cube_9 was taken away"),
        ("why does the robot wait", "The robot wants nothing."),
        ("where is the gripper", "gripper is at x 0.10 m, y 0.20 m, z 0.50 m."),
        ("where is anne", "Nobody knows where anne is."),
        ("how do you know that cube_3 is on cube_4", "the two touch in the simulation of physics for 50.0 s"),
        ("is the mission finished?", "The robot wants nothing."),
        ("anything new?", "cube_9 was taken away"),
        ("was there a surprise?", "the robot concluded that cup moved"),
        ("could the ball be somewhere else?", "No other place is probable."),
        ("where does anne think the ball is", "That cannot be told: nobody keeps the world of anne"),
    ],
)
def test_answers_that_are_sentences(kitchen: Moment, question: str, words: str) -> None:
    response = ask(kitchen, question)
    assert response.understood and words in response.text, response.text


def test_the_answer_is_as_sure_as_its_evidence(kitchen: Moment) -> None:
    questions = ("where is the cup", "where is the ball", "who picked the ball up")
    seen, believed, inferred = (ask(kitchen, one) for one in questions)
    assert (seen.basis, believed.basis) == (Basis.PERCEIVED, Basis.BELIEVED)
    assert inferred.confidence == 0.9 and inferred.evidence[0].evidence["kind"] == "Pick"
    assert believed.evidence[0].evidence["seconds_unseen"] == 200.0
    assert msgspec.json.decode(msgspec.json.encode(believed), type=Response) == believed


@pytest.mark.parametrize(
    ("question", "part", "why"),
    [
        ("where is the cub_3", "cub_3", "nothing is called 'cub_3'; did you mean 'cube_3'"),
        ("where is the cube", "cube", "'cube' may be cube_10, cube_3, cube_4 and cube_9: which one?"),
        ("where is the ball and why", "", "The question ends too early, after 'why'."),
    ],
)
def test_what_is_not_understood(kitchen: Moment, question: str, part: str, why: str) -> None:
    response = ask(kitchen, question)
    assert not response.understood and response.part == part and why in response.text
    assert len(response.similar) == 3 and all(ask(kitchen, one).understood for one in response.similar)


def test_every_kind_of_question_has_an_answer(kitchen: Moment) -> None:
    responses = [ask(kitchen, one) for one in example_questions(kitchen)]
    assert [one.question for one in responses if not one.understood] == []


def simulated(moment: Moment, question: str, found: Answer) -> tuple[list[Question], Response]:
    """What the simulation handler is asked, and the response to what it answers."""
    thought: Any = answer(moment, question)
    asked = [next(thought)]
    with pytest.raises(StopIteration) as ended:
        thought.send(found)
    return asked, ended.value.value


def test_what_if_is_asked_of_the_simulation(kitchen: Moment) -> None:
    pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    found = Answer(
        seconds=1.0, at_rest=True, poses={"cube_3": pose, "cup": pose}, moved={"cube_3": 0.04, "cup": 0.0},
        rests_on={"cube_3": ("table",), "cup": ("table",)},
    )  # fmt: skip
    (question,), response = simulated(kitchen, "what if cube_4 were removed?", found)
    assert question.changes == (Supposed.remove("cube_4"),)
    assert response.names == ("cube_3",)
    assert response.text == "cube_3 would rest on table then, 0.04 m from where it is now."
    _, response = simulated(kitchen, "would the cup fall if cube_4 were removed?", found)
    assert response.verdict is False and response.text == "It would stay: cup would rest on table then."
    (question,), _ = simulated(kitchen, "what if the cup were put on the box?", found)
    (change,) = question.changes
    assert change.object == "cup" and change.pose is not None
    assert change.pose[:3] == pytest.approx((0.5, 0.0, 0.0905), abs=1e-6)  # box: 0.05 + 0.02 high; the cup's half: 0.02
    assert ask(kitchen, "what if cube_4 were held?").text == "That was not simulated: nobody simulates."
    assert ask(kitchen, "what if cube_10 were put on the box?").text == "Nobody knows where cube_10 is, or how large."


def test_what_moves_anyway_does_not_follow_from_a_change(kitchen: Moment) -> None:
    rolls = (0.7, 0.1, 0.04, 0.0, 0.0, 0.0, 1.0)
    found = Answer(
        seconds=2.0, poses={"cup": rolls}, moved={"cup": 0.4}, rests_on={"cup": ("table",)}, anyway={"cup": rolls}
    )
    _, response = simulated(kitchen, "what if cube_4 were removed?", found)
    assert response.text == "Nothing else would move."
    _, response = simulated(kitchen, "would anything move if cube_4 were removed?", found)
    assert response.verdict is False
    _, response = simulated(kitchen, "would the cup fall if cube_4 were removed?", found)
    assert response.verdict is True
    assert response.text == "It would move anyway: cup would rest on table then, 0.40 m from where it is now."
