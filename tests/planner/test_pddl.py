"""World states as PDDL, solved and read back: what the plan does is what the goal wants."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsr import Pose
from dsr.clock import WALL_CLOCK
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.relations import Relation, Relations
from planner.errors import GoalNotPossible, SolverFailed, Unsolvable
from planner.pddl import DOMAIN, Names, names_of, problem
from planner.plan import PlanStep, leads_to, read_plan
from planner.solver import solve
from planner.state import KnownSolid, WorldState

CUBE = KnownSolid((0.04, 0.04, 0.04), Pose((0.4, 0.0, 0.02)))


def state(towers: list[list[str]], held: str = "", **options: frozenset[str]) -> WorldState:
    """Towers on a table, each from its lowest thing up."""
    on = {(above, below) for tower in towers for below, above in itertools.pairwise(["table", *tower])}
    things = frozenset(itertools.chain(*towers)) | ({held} if held else set())
    relations = Relations(
        things, frozenset({"table"}), frozenset(on), frozenset({("gripper", held)} if held else set())
    )
    values = {"graspable": things, "flat": things, **options}
    return WorldState(relations, dict.fromkeys(things, CUBE), "table", **values)


def plan(now: WorldState, goal: Goal) -> tuple[PlanStep, ...]:
    solution = solve(DOMAIN, problem(now, goal), WALL_CLOCK, limit=60.0)
    return read_plan(solution.plan, names_of(now), "table")


towers = st.permutations([f"cube_{number}" for number in range(6)]).flatmap(
    lambda order: st.lists(st.integers(1, 3), min_size=6, max_size=6).map(lambda sizes: cut(order, sizes))
)


def cut(order: list[str], sizes: list[int]) -> list[list[str]]:
    parts, rest = [], list(order)
    for size in sizes:
        if rest:
            parts.append(rest[:size])
            rest = rest[size:]
    return parts


@given(towers, towers, st.booleans())
@settings(max_examples=12)
def test_a_plan_leads_from_any_towers_to_any_others(now: list[list[str]], then: list[list[str]], held: bool) -> None:
    start = state(now) if not held else state([tower for tower in (now[0][:-1], *now[1:]) if tower], now[0][-1])
    wanted = [Relation("on", (above, below)) for t in then for below, above in itertools.pairwise(["table", *t])]
    goal = Goal((*wanted, Relation("handempty", ())))
    steps = plan(start, goal)
    assert goal.holds(leads_to(steps, start.relations))


@given(st.lists(st.text("aZ0._-&", min_size=1, max_size=6), min_size=1, max_size=30, unique=True))
def test_names_go_there_and_back(nodes: list[str]) -> None:
    names = Names(nodes)
    pddl = [names.pddl(node) for node in nodes]
    assert [names.node(name) for name in pddl] == nodes
    assert len({name.lower() for name in pddl}) == len(nodes)
    assert all(name[0].isalpha() and name.isascii() and not set(name) & set(".&() ") for name in pddl)


def test_plain_names_stay_as_they_are_and_reserved_ones_do_not() -> None:
    names = Names(["cube_3", "and", "Cube.3", "thing"])
    assert [names.pddl(name) for name in ("cube_3", "Cube.3")] == ["cube_3", "n1_cube_3"]
    assert names.pddl("and") not in ("and", "thing") and names.pddl("thing") != "thing"


def test_strange_names_are_planned_with() -> None:
    start = state([["Cube.3"], ["and"]])
    assert plan(start, parse_goal("on(Cube.3, table)")) == ()
    assert [str(step) for step in plan(start, Goal((Relation("on", ("and", "Cube.3")),)))] == [
        "pick and", "stack and on Cube.3",
    ]  # fmt: skip


def test_the_problem_says_what_is_believed() -> None:
    text = problem(state([["cube_4", "cube_3"]], "cube_5"), parse_goal("on(cube_5,table) & clear(cube_3)"))
    for fact in ("(on cube_3 cube_4)", "(ontable cube_4)", "(holding cube_5)", "(graspable cube_3)", "(flat cube_4)"):
        assert f"    {fact}" in text
    assert "(clear" not in text.partition(":goal")[0] and "handempty" not in text
    assert text.rstrip().endswith("(:goal (and\n    (ontable cube_5)\n    (clear cube_3))))")


def test_what_lies_on_two_things_leaves_both_free_when_it_is_picked() -> None:
    start = state([["cube_3"], ["cube_4"], ["cube_5", "plank"]])
    relations = Relations(start.relations.things, start.relations.tables, start.relations.on | {("plank", "cube_4")})
    start = WorldState(relations, start.solids, "table", start.graspable, start.flat)
    steps = plan(start, parse_goal("on(cube_3,cube_4) & on(plank,table)"))
    assert [str(step) for step in steps] == [
        "pick plank", "putdown plank on table", "pick cube_3", "stack cube_3 on cube_4",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("goal", "options"),
    [
        ("on(cube_3,cube_4) & on(cube_4,cube_3)", {}),
        ("holding(cube_3) & handempty", {}),
        ("on(cube_3,cube_4)", {"graspable": frozenset({"cube_4"})}),
        ("on(cube_3,cube_4)", {"flat": frozenset({"cube_3"})}),
    ],
)
def test_what_cannot_be_is_unsolvable(goal: str, options: dict[str, frozenset[str]]) -> None:
    with pytest.raises(Unsolvable):
        plan(state([["cube_3"], ["cube_4"]], **options), parse_goal(goal))


def test_what_somebody_else_holds_is_not_grasped() -> None:
    relations = Relations(frozenset({"cube_3", "cube_4"}), frozenset({"table"}), taken=frozenset({"cube_3"}))
    now = WorldState(relations, {}, "table", frozenset({"cube_3", "cube_4"}), frozenset({"cube_3", "cube_4"}))
    with pytest.raises(Unsolvable):
        plan(now, parse_goal("on(cube_3,cube_4)"))


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("on(table,cube_3)", "'table' is a table"),
        ("on(cube_3,cube_9)", "'cube_9' is not believed to be anywhere"),
        ("on(cube_3,desk)", "on 'table' only"),
    ],
)
def test_what_the_domain_cannot_express_is_told(goal: str, message: str) -> None:
    now = state([["cube_3"]])
    relations = Relations(now.relations.things, frozenset({"table", "desk"}), now.relations.on)
    with pytest.raises(GoalNotPossible, match=message):
        problem(WorldState(relations, now.solids, "table"), parse_goal(goal))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(fly cube_3)", "which is no step"),
        ("(pick cube_3 cube_4)", "which is no step"),
        ("pick cube_3", "which is no step"),
        ("(pick cube_9)", "there is no 'cube_9'"),
    ],
)
def test_a_plan_file_that_is_none_is_refused(text: str, message: str) -> None:
    with pytest.raises(SolverFailed, match=message):
        read_plan(text, Names(["cube_3", "cube_4"]), "table")


def test_a_plan_that_is_not_possible_is_refused() -> None:
    start = state([["cube_4", "cube_3"]])
    with pytest.raises(SolverFailed, match="step 1 of the plan, pick cube_4, is not possible"):
        leads_to((PlanStep("pick", "cube_4"),), start.relations)
