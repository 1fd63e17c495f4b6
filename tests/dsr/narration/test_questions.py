"""The grammar of questions: what is asked for, and which part is not understood."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.narration.grammar import EXAMPLES
from dsr.narration.questions import Misunderstanding, Query, parse_question, parse_questions, similar_questions


@pytest.mark.parametrize(
    ("question", "query"),
    [
        ("where is the ball?", Query(kind="where", things=("ball",))),
        ("Where's Cube_3", Query(kind="where", things=("cube_3",))),
        ("where was the ball 2 minutes ago", Query(kind="where", things=("ball",), when="2 minutes ago")),
        ("where was the ball at 12.5 s?", Query(kind="where", things=("ball",), at=12.5)),
        ("where does Sally think the cube is?", Query(kind="where_by", things=("sally", "cube"))),
        ("where will sally look for the cube", Query(kind="where_by", things=("sally", "cube"))),
        ("when was cube_3 last seen?", Query(kind="last_seen", things=("cube_3",))),
        ("when did anne last see the second cup", Query(kind="last_seen_by", things=("anne", "second cup"))),
        ("what is underneath cube_3", Query(kind="contents", things=("cube_3",), relation="under")),
        ("what does sally think is in the first cup",
         Query(kind="contents_by", things=("sally", "first cup"), relation="in")),
        ("was the ball in the green box 1 second ago?",
         Query(kind="is_so", things=("ball", "green box"), relation="in", when="1 second ago")),
        ("is cube_3 next to cube_4", Query(kind="is_so", things=("cube_3", "cube_4"), relation="next")),
        ("does sally believe that the cube is inside the cup",
         Query(kind="is_so_by", things=("sally", "cube", "cup"), relation="in")),
        ("does anne know where the cube is", Query(kind="knows", things=("anne", "cube"))),
        ("is there a ball?", Query(kind="is_there", things=("ball",), word="there")),
        ("is cube_3 missing", Query(kind="is_there", things=("cube_3",), word="gone")),
        ("can sally see the cube", Query(kind="sees", things=("sally", "cube"))),
        ("who held cube_3 at 9 s", Query(kind="holder", things=("cube_3",), at=9.0)),
        ("has the cup been moved since noon?", Query(kind="was_done", things=("cup",), word="move", when="since noon")),
        ("which cube is the biggest?", Query(kind="extreme", things=("cube",), word="largest")),
        ("what is the lightest of the cubes", Query(kind="extreme", things=("cubes",), word="lightest")),
        ("could the ball be somewhere else?", Query(kind="where_else", things=("ball",))),
        ("does the box contain the ball", Query(kind="is_so", things=("ball", "box"), relation="in")),
        ("when was the ball picked up", Query(kind="when_was", things=("ball",), word="pick")),
        ("who took the ball away", Query(kind="who_did", things=("ball",), word="pick")),
        ("how long has the ball been in the box", Query(kind="how_long_so", things=("ball", "box"), relation="in")),
        ("why is cube_3 believed to be on cube_4",
         Query(kind="why_so", things=("cube_3", "cube_4"), relation="on")),
        ("why isn't the ball visible", Query(kind="why_state", things=("ball",))),
        ("why is the ball not visible", Query(kind="why_state", things=("ball",), word="unseen")),
        ("what happened to the ball in the last 10 s",
         Query(kind="happened", things=("ball",), when="in the last 10 s")),
        ("what happened in the last minute?", Query(kind="happened", when="in the last minute")),
        ("what would happen if cube_4 were taken away", Query(kind="what_if", things=("cube_4",), word="remove")),
        ("what if I put cube_3 on cube_5", Query(kind="what_if", things=("cube_3", "cube_5"), word="put")),
        ("would cube_3 fall if cube_4 were removed",
         Query(kind="would", things=("cube_3", "cube_4"), word="remove")),
        ("what is the robot waiting for", Query(kind="wants", things=("robot",))),
        ("how many cubes are there", Query(kind="count", things=("cubes",))),
        ("can you please tell me where cube_3 is right now", Query(kind="where", things=("cube_3",))),
        ("Where's cube_3 got to?", Query(kind="where", things=("cube_3",))),
        ("which box is the ball in", Query(kind="where_in", things=("box", "ball"), relation="in")),
        ("what's sitting on top of cube_2", Query(kind="contents", things=("cube_2",), relation="on")),
        ("is there anything under cube_5", Query(kind="any_so", things=("cube_5",), relation="under")),
        ("is there a cube on the table", Query(kind="any_so", things=("cube", "table"), relation="on")),
        ("how many cubes are on the table", Query(kind="count", things=("cubes", "table"), relation="on")),
        ("did somebody move cube_3", Query(kind="did_any", things=("cube_3",), word="move")),
        ("was the ball picked up yesterday?", Query(kind="was_done", things=("ball",), word="pick", when="yesterday")),
        ("yesterday, who moved the cup", Query(kind="who_did", things=("cup",), word="move", when="yesterday")),
        ("which cubes can't the camera see", Query(kind="what_unseen", things=("cubes", "camera"))),
        ("why isn't the robot doing anything", Query(kind="why_waits", things=("robot",))),
        ("if I took cube_2 away, would anything fall over", Query(kind="would", things=("cube_2",), word="remove")),
        ("how sure are you that cube_3 is there", Query(kind="sure", things=("robot", "cube_3"))),
        ("what's the closest thing to cube_3", Query(kind="closest", things=("thing", "cube_3"))),
        ("has anything changed since this morning", Query(kind="happened", when="since this morning")),
        ("what was surprising on 12 November", Query(kind="surprises", when="on 12 november")),
        ("what colour is the large box", Query(kind="property", things=("large box",), word="colour")),
        ("is the ball still in the cup", Query(kind="is_so", things=("ball", "cup"), relation="in")),
        ("what happened since 9", Query(kind="happened", since=9.0)),
        ("So, under which box is the ball hidden?", Query(kind="where_in", things=("box", "ball"), relation="under")),
        ("where did the ball end up", Query(kind="where", things=("ball",))),
        ("has the ball ever been in the cup", Query(kind="was_so", things=("ball", "cup"), relation="in", when="ever")),
        ("isn't the ball in the cup any more", Query(kind="is_so", things=("ball", "cup"), relation="in")),
        ("the ball is in the cup, isn't it?", Query(kind="is_so", things=("ball", "cup"), relation="in")),
        ("how come the ball isn't in the cup", Query(kind="why_not_so", things=("ball", "cup"), relation="in")),
        ("are cube_3 and the cup where they were", Query(kind="unmoved", things=("cube_3 and cup", "they"))),
        ("is somebody behind the box", Query(kind="any_so", things=("box",), relation="behind", word="body")),
        ("what is to the left of the cup, as seen from sally",
         Query(kind="contents", things=("cup",), relation="left", view="sally")),
        ("what's in front of the cup from anne's point of view",
         Query(kind="contents", things=("cup",), relation="front", view="anne")),
        ("where is the left cup", Query(kind="where", things=("left cup",))),
        ("did any of the two cubes fall", Query(kind="was_done", things=("any two cubes",), word="fall")),
        ("are all cubes on the table", Query(kind="is_so", things=("all cubes", "table"), relation="on")),
        ("what did the hand do with the ball", Query(kind="deeds_of", things=("hand", "ball"))),
        ("what was the last thing the hand picked up",
         Query(kind="last_done", things=("thing", "hand"), word="pick")),
        ("who put the ball in the box", Query(kind="who_did", things=("ball", "box"), relation="in", word="put")),
        ("what is anne looking at", Query(kind="what_sees", things=("anne",))),
        ("does anne know that the ball was moved", Query(kind="knows", things=("anne", "ball"), word="move")),
        ("how long has the cup been standing there", Query(kind="how_long_there", things=("cup",))),
    ],
)  # fmt: skip
def test_a_question_is_read(question: str, query: Query) -> None:
    assert parse_question(question) == query


@pytest.mark.parametrize("example", EXAMPLES.values())
def test_every_example_is_understood(example: str) -> None:
    for name, value in (("THING", "first cup"), ("OTHER", "cube_3"), ("PERSON", "sally")):
        example = example.replace(name, value)
    assert all(isinstance(one, Query) for one in parse_questions(example))


@pytest.mark.parametrize(
    ("question", "part"),
    [
        ("tell me a joke about the ball", "tell me a joke about the ball"),
        ("where was the ball yesterday when it fell on Tuesday", "on tuesday"),
        ("where is", ""),
        ("where is the ball # now", "# now"),
        ("where is the ball # today", "# today"),
        ("who picked the ball on the table", "on the table"),
        ("why", ""),
        ("", ""),
    ],
)
def test_what_is_not_understood_is_told(question: str, part: str) -> None:
    found = parse_question(question)
    assert isinstance(found, Misunderstanding) and found.part == part, found
    assert len(found.similar) == 3 and found.why.endswith(".")


def test_two_questions_in_one_share_the_thing_and_the_time() -> None:
    asked = "Where was the cup last Tuesday, and who moved it?"
    assert parse_questions(asked) == [
        Query(kind="where", things=("cup",), when="last tuesday"),
        Query(kind="who_did", things=("cup",), word="move", when="last tuesday"),
    ]
    where, holder = parse_questions("where is the ball and who holds it")
    assert isinstance(where, Query) and isinstance(holder, Query) and holder.things == ("ball",)
    nonsense = parse_questions("where is the ball and why on earth")
    assert isinstance(nonsense[1], Misunderstanding) and len(nonsense) == 2
    assert len(parse_questions(" and ".join(["where is the ball"] * 9))) == 1


def test_similar_questions_are_like_the_one_that_was_asked() -> None:
    assert similar_questions("since what time is it on the table")[0] == EXAMPLES["since_when"]


_WORDS = st.sampled_from(["where", "is", "was", "the", "ball", "on", "why", "10", "s", "ago", "if", "?", "#"])


def test_a_question_that_is_too_long_is_not_read() -> None:
    found = parse_question("where is the " + "very " * 200 + "red ball")
    assert isinstance(found, Misunderstanding) and "at most 300 characters" in found.why


@given(st.text(max_size=60) | st.lists(_WORDS, max_size=20).map(" ".join))
def test_any_text_is_read_or_not_understood(text: str) -> None:
    assert isinstance(parse_question(text), Query | Misunderstanding)
