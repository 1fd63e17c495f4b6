"""The grammar of questions: what is asked for, and which part is not understood."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.narration.questions import EXAMPLES, Misunderstanding, Query, parse_question, similar_questions


@pytest.mark.parametrize(
    ("question", "query"),
    [
        ("where is the ball?", Query(kind="where_now", things=("ball",))),
        ("Where's Cube_3", Query(kind="where_now", things=("cube_3",))),
        ("where was the ball 2 minutes ago", Query(kind="where_then", things=("ball",), ago=120.0)),
        ("where was the ball at 12.5 s?", Query(kind="where_then", things=("ball",), at=12.5)),
        ("where does Sally think the cube is?", Query(kind="where_by", things=("sally", "cube"))),
        ("where will sally look for the cube", Query(kind="where_by", things=("sally", "cube"))),
        ("when was cube_3 last seen?", Query(kind="last_seen", things=("cube_3",))),
        ("when did anne last see the second cup", Query(kind="last_seen_by", things=("anne", "second cup"))),
        ("what is underneath cube_3", Query(kind="contents", things=("cube_3",), relation="under")),
        ("what does sally think is in the first cup",
         Query(kind="contents_by", things=("sally", "first cup"), relation="in")),
        ("was the ball in the green box 1 second ago?",
         Query(kind="is_so", things=("ball", "green box"), relation="in", ago=1.0)),
        ("is cube_3 next to cube_4", Query(kind="is_so", things=("cube_3", "cube_4"), relation="next")),
        ("does sally believe that the cube is inside the cup",
         Query(kind="is_so_by", things=("sally", "cube", "cup"), relation="in")),
        ("does anne know where the cube is", Query(kind="knows", things=("anne", "cube"))),
        ("is there a ball?", Query(kind="is_there", things=("ball",), word="there")),
        ("is cube_3 missing", Query(kind="is_there", things=("cube_3",), word="gone")),
        ("can sally see the cube", Query(kind="sees", things=("sally", "cube"))),
        ("who held cube_3 at 9 s", Query(kind="holder", things=("cube_3",), at=9.0)),
        ("when was the ball picked up", Query(kind="when_was", things=("ball",), word="pick")),
        ("who took the ball away", Query(kind="who_did", things=("ball",), word="pick")),
        ("how long has the ball been in the box", Query(kind="how_long_so", things=("ball", "box"), relation="in")),
        ("why is cube_3 believed to be on cube_4",
         Query(kind="why_so", things=("cube_3", "cube_4"), relation="on")),
        ("why isn't the ball visible", Query(kind="why_state", things=("ball",))),
        ("why is the ball not visible", Query(kind="why_state", things=("ball",), word="unseen")),
        ("what happened to the ball in the last 10 s", Query(kind="happened", things=("ball",), ago=10.0)),
        ("what happened in the last minute?", Query(kind="happened", ago=60.0)),
        ("what would happen if cube_4 were taken away", Query(kind="what_if", things=("cube_4",), word="remove")),
        ("what if I put cube_3 on cube_5", Query(kind="what_if", things=("cube_3", "cube_5"), word="put")),
        ("would cube_3 fall if cube_4 were removed",
         Query(kind="would", things=("cube_3", "cube_4"), word="remove")),
        ("what is the robot waiting for", Query(kind="wants", things=("robot",))),
        ("how many cubes are there", Query(kind="count", things=("cubes",))),
    ],
)  # fmt: skip
def test_a_question_is_read(question: str, query: Query) -> None:
    assert parse_question(question) == query


@pytest.mark.parametrize("example", EXAMPLES.values())
def test_every_example_is_understood(example: str) -> None:
    for name, value in (("THING", "first cup"), ("OTHER", "cube_3"), ("PERSON", "sally")):
        example = example.replace(name, value)
    assert isinstance(parse_question(example), Query)


@pytest.mark.parametrize(
    ("question", "part"),
    [
        ("tell me where the ball is", "tell me where the ball is"),
        ("where is", ""),
        ("where is the ball # now", "# now"),
        ("who picked the ball on the table", "on the table"),
        ("why", ""),
        ("", ""),
    ],
)
def test_what_is_not_understood_is_told(question: str, part: str) -> None:
    found = parse_question(question)
    assert isinstance(found, Misunderstanding) and found.part == part, found
    assert len(found.similar) == 3 and found.why.endswith(".")


def test_similar_questions_are_like_the_one_that_was_asked() -> None:
    assert similar_questions("since what time is it on the table")[0] == EXAMPLES["since_when"]


_WORDS = st.sampled_from(["where", "is", "was", "the", "ball", "on", "why", "10", "s", "ago", "if", "?", "#"])


def test_a_question_that_is_too_long_is_not_read() -> None:
    found = parse_question("where is the " + "very " * 200 + "red ball")
    assert isinstance(found, Misunderstanding) and "at most 300 characters" in found.why


@given(st.text(max_size=60) | st.lists(_WORDS, max_size=20).map(" ".join))
def test_any_text_is_read_or_not_understood(text: str) -> None:
    assert isinstance(parse_question(text), Query | Misunderstanding)
