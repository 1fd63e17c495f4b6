"""Goals: what their text means, and how an error points at the place."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr import ConfigError, GoalError, LocalNetwork, ManualClock, Memory, Pose
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.intentions import add_intention
from dsr.vocabulary.relations import ARITY, Relation, Relations, read_relations

names = st.text("abcXYZ012_.-", min_size=1, max_size=8).filter(lambda name: name.lower() not in ("and", "or", "not"))
spaces = st.text(" \t\n", max_size=2)


@st.composite
def relations(draw: st.DrawFn) -> Relation:
    name = draw(st.sampled_from(sorted(ARITY)))
    return Relation(name, tuple(draw(st.lists(names, min_size=ARITY[name], max_size=ARITY[name], unique=True))))


@given(st.lists(relations(), min_size=1, max_size=5, unique=True))
def test_a_goal_is_read_as_it_is_written(wanted: list[Relation]) -> None:
    assert parse_goal(str(Goal(tuple(wanted)))).relations == tuple(wanted)


@given(st.lists(relations(), min_size=1, max_size=4, unique=True), st.data())
def test_spaces_capitals_and_the_word_and_make_no_difference(wanted: list[Relation], data: st.DataObject) -> None:
    text = ""
    for number, (name, things) in enumerate(wanted):
        gap = data.draw(spaces)
        text += data.draw(st.sampled_from(["&", " and ", " AND "])) if number else ""
        inner = f"{gap},{gap}".join(things)
        text += f"{gap}{data.draw(st.sampled_from([name, name.upper()]))}{gap}({gap}{inner}{gap}){gap}"
    assert parse_goal(text).relations == tuple(wanted)


@given(st.text(alphabet="onclear()&,. \n\tcube_3Ä|'\"\\and", max_size=40))
def test_any_text_is_a_goal_or_an_error_that_points_into_it(text: str) -> None:
    try:
        goal = parse_goal(text)
    except GoalError as error:
        assert 0 <= error.column <= len(text)
        assert error.reason
    else:
        assert parse_goal(str(goal)) == goal


@pytest.mark.parametrize(
    ("text", "column", "message"),
    [
        ("", 0, "expected a relation, such as on(cube_3,cube_4) & clear(cube_3)"),
        ("on(cube_3 cube_4)", 10, "expected ',' or ')' after 'cube_3', found 'cube_4'"),
        ("on(cube_3,cube_4", 16, "expected ',' or ')' after 'cube_4'"),
        ("on(cube_3,", 10, "expected the name of a thing; write on(cube_3,cube_4)"),
        ("on(cube_3)", 0, "on takes 2 things, not 1; write on(cube_3,cube_4)"),
        ("clear", 0, "clear takes 1 thing, not 0; write clear(cube_3)"),
        ("on(a,b) clear(a)", 8, "expected '&' or the end after on(a,b), found 'clear'"),
        ("on(a,b) &", 9, "expected a relation, such as on(cube_3,cube_4) & clear(cube_3)"),
        ("on(a,b) & onn(b,c)", 10, "unknown relation 'onn'; did you mean 'on'?"),
        ("on(a,b) & xyz(b)", 10, "unknown relation 'xyz'; valid: clear, handempty, holding, on, ontable"),
        ("on(a,b) | on(c,d)", 8, "unexpected '|'; relations are joined by '&' or 'and'"),
        ("not clear(a)", 0, "'not' is not possible: a goal is relations joined by '&', all of them wanted"),
        ("on(a,a)", 5, "'a' cannot be on itself"),
        ("on(a,(b))", 5, "expected the name of a thing, found '('; write on(cube_3,cube_4)"),
        ("& on(a,b)", 0, "expected a relation, found '&'; valid: clear, handempty, holding, on, ontable"),
        (f"clear({'x' * 129})", 6, "a name may have at most 128 characters, not 129"),
    ],
)
def test_errors_point_at_the_place(text: str, column: int, message: str) -> None:
    with pytest.raises(GoalError) as caught:
        parse_goal(text)
    assert (caught.value.column, caught.value.reason) == (column, message)


def test_an_error_shows_the_text_with_a_caret() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_goal("on(cube_3,\ncube_4) & claer(cube_3)")
    assert str(caught.value).splitlines() == [
        "on(cube_3, cube_4) & claer(cube_3)",
        "                     ^",
        "unknown relation 'claer'; did you mean 'clear'?",
    ]


def test_the_caret_stays_below_its_place_in_a_long_text() -> None:
    text = " & ".join(f"clear(cube_{number})" for number in range(100)) + " & oops"
    with pytest.raises(GoalError) as caught:
        parse_goal(text)
    shown, caret, _ = str(caught.value).splitlines()
    assert shown[caret.index("^") :] == "oops" and len(shown) <= 100


def test_names_that_are_not_known_are_pointed_at() -> None:
    goal = parse_goal("on(cube_3,cube_44)")
    goal.check_names(["cube_3", "cube_44"])
    with pytest.raises(GoalError, match="there is no 'cube_44'; valid: cube_3, cube_4") as caught:
        goal.check_names(["cube_3", "cube_4"])
    assert caught.value.column == 10


def test_each_relation_is_evaluated() -> None:
    now = Relations(
        things=frozenset("abcde"),
        tables=frozenset({"table"}),
        on=frozenset({("a", "b"), ("b", "table"), ("d", "table")}),
        grasping=frozenset({("gripper", "c")}),
        taken=frozenset("e"),
    )
    for text in ("on(a,b)", "on(b,table)", "ontable(d)", "clear(a)", "clear(d)", "holding(c)", "on(a,b)&holding(c)"):
        assert parse_goal(text).holds(now), text
    for text in ("on(b,a)", "ontable(a)", "clear(b)", "clear(c)", "clear(e)", "clear(x)", "holding(a)", "handempty"):
        assert parse_goal(text).missing(now) == parse_goal(text).relations, text
    assert parse_goal("handempty").holds(Relations())


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock()
    return Memory("test", "reader", transport=LocalNetwork(clock).connect("reader"), clock=clock)


def test_relations_come_from_what_is_believed(memory: Memory) -> None:
    for name, kind in [("world", "world"), ("table", "table"), ("gripper", "gripper"), ("human_hand_0", "hand")]:
        memory.add_node(name, kind)
    for number in range(6):
        memory.add_node(f"cube_{number}", "cube")
    for number in range(4):
        memory.add_edge("world", f"cube_{number}", "Virtual_RT", pose=Pose())
    memory.update_node("cube_3", present=False)
    memory.add_edge("cube_0", "table", "on")
    memory.add_edge("cube_1", "cube_0", "on")
    memory.add_edge("cube_3", "table", "on")
    memory.add_edge("cube_5", "table", "on")
    memory.add_edge("gripper", "cube_4", "grasping")
    memory.add_edge("human_hand_0", "cube_2", "grasping")
    found = read_relations(memory)
    assert found == Relations(
        things=frozenset({"cube_0", "cube_1", "cube_2", "cube_4"}),
        tables=frozenset({"table"}),
        on=frozenset({("cube_0", "table"), ("cube_1", "cube_0")}),
        grasping=frozenset({("gripper", "cube_4")}),
        taken=frozenset({"cube_2"}),
    )
    assert sorted(map(str, found.facts)) == ["holding(cube_4)", "on(cube_0,table)", "on(cube_1,cube_0)"]


def test_intentions_get_the_smallest_free_number(memory: Memory) -> None:
    assert [add_intention(memory, "handempty") for _ in range(3)] == ["intention_0", "intention_1", "intention_2"]
    memory.remove_node("intention_1")
    assert add_intention(memory, "handempty", maintain=True, priority=2) == "intention_1"
    assert dict(memory.node("intention_1")) == {
        "goal": "handempty", "maintain": True, "priority": 2, "status": "wanted",
    }  # fmt: skip
    assert len(memory.edges("has", src="mind")) == 3
