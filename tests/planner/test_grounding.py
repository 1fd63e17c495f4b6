"""Where things are put on the table: free, within reach, in view, near; the same each time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.believing.distribution import Alternative
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.relations import Relations
from planner.config import PlannerConfig
from planner.covers import Covers
from planner.errors import NoPlace
from planner.grounding import ground, is_free, place_on_table, stacked
from planner.plan import PlanStep
from planner.state import KnownSolid, PossiblePlace, TableCamera, WorldState, read_state
from tests.planner.table import Run, believe, set_table

CONFIG = PlannerConfig()
SIZE = (0.04, 0.04, 0.04)
TABLE = KnownSolid((1.2, 0.8, 0.03), Pose((0.4, 0.0, 0.1)))
DOWN = Pose((0.35, 0.0, 0.75), (0.70710678, -0.70710678, 0.0, 0.0))
OVERHEAD = TableCamera("overhead", DOWN.inverse(), Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480))


def world(*places: tuple[float, float], views: tuple[TableCamera, ...] = (), table: KnownSolid = TABLE) -> WorldState:
    names = [f"cube_{number}" for number in range(len(places))]
    solids = {name: KnownSolid(SIZE, Pose((*place, 0.12))) for name, place in zip(names, places, strict=True)}
    relations = Relations(frozenset(names), frozenset({"table"}), frozenset((name, "table") for name in names))
    return WorldState(relations, {"table": table, **solids}, "table", frozenset(names), frozenset(names), views=views)


places = st.tuples(st.floats(0.0, 0.9), st.floats(-0.4, 0.4))


@given(st.lists(places, min_size=1, max_size=12))
def test_a_place_is_free_within_reach_and_in_view(where: list[tuple[float, float]]) -> None:
    state = world(*where, views=(OVERHEAD,))
    try:
        pose = place_on_table("cube_0", state, CONFIG)
    except NoPlace:
        assert len(where) > 6
        return
    x, y, z = pose.t
    assert z == pytest.approx(0.12)
    assert CONFIG.least_reach <= math.hypot(x, y) <= CONFIG.most_reach
    for other in where[1:]:
        assert math.dist((x, y), other) >= CONFIG.least_clearance + 2 * 0.0282
    assert OVERHEAD.sees(np.array([[x, y, 0.14]]), 0.0282).all()
    assert is_free(pose, "cube_0", state, CONFIG)
    assert place_on_table("cube_0", state, CONFIG) == pose


def test_the_nearest_place_is_taken_and_bad_ones_are_avoided() -> None:
    state = world((0.42, 0.08))
    first = place_on_table("cube_0", state, CONFIG)
    assert math.dist(first.t[:2], (0.42, 0.08)) <= 0.0142
    second = place_on_table("cube_0", state, CONFIG, [(first.t[0], first.t[1])])
    assert 0.01 < math.dist(first.t[:2], second.t[:2]) < 0.03


def test_a_place_is_free_in_worlds_that_are_probable_enough() -> None:
    state = world((0.42, 0.08), (0.2, -0.3))
    near = place_on_table("cube_0", state, CONFIG)
    for probability, is_good in ((0.1, True), (0.3, False)):
        doubtful = replace(state, doubts={"cube_1": (PossiblePlace(probability, near.t[:2]),)})
        assert is_free(near, "cube_0", doubtful, CONFIG) == is_good
        place = place_on_table("cube_0", doubtful, CONFIG)
        assert (place == near) == is_good
        assert is_good or math.dist(place.t[:2], near.t[:2]) >= 2 * 0.0282 + CONFIG.clearance
        assert is_free(place, "cube_0", doubtful, CONFIG)
    half = replace(state, doubts={"cube_0": (PossiblePlace(0.5, near.t[:2]), PossiblePlace(0.5, (0.42, 0.08)))})
    assert place_on_table("cube_0", half, CONFIG) == near, "what is put down is in nobody's way"


def test_doubts_of_several_things_add_up_and_the_most_probable_place_is_left() -> None:
    state = world((0.42, 0.08), (0.2, -0.3), (0.2, 0.3))
    near = place_on_table("cube_0", state, CONFIG)
    two = {name: (PossiblePlace(0.15, near.t[:2]),) for name in ("cube_1", "cube_2")}
    assert place_on_table("cube_0", replace(state, doubts=two), CONFIG) != near
    tray = KnownSolid((1.6, 1.6, 0.02), Pose((5.0, 5.0, 0.12)))
    beset = {"tray": (PossiblePlace(0.3, (0.4, 0.0)),), "cube_2": (PossiblePlace(0.3, near.t[:2]),)}
    crowded = replace(state, solids={**state.solids, "tray": tray}, doubts=beset)
    place = place_on_table("cube_0", crowded, CONFIG)
    assert not is_free(place, "cube_0", crowded, CONFIG), "the tray may be anywhere within reach"
    assert 2 * 0.0282 + CONFIG.clearance <= math.dist(place.t[:2], near.t[:2]) < 0.15


def test_where_things_may_be_is_read_but_for_what_is_in_hands() -> None:
    with Run() as run:
        there = Alternative(weight=0.3, pose=Pose((0.5, 0.2, 0.02)))
        carried = Alternative(weight=0.2, pose=Pose((0.1, 0.4, 0.2)), hand="hand_0")
        here = Alternative(weight=0.5, pose=Pose((0.42, 0.08, 0.02)))
        believe(run.memory, "cube_3", here, there, carried)
        state = read_state(run.memory, CONFIG)
    assert state.doubts.keys() == {"cube_3"}
    assert state.doubts["cube_3"] == (PossiblePlace(0.5, (0.42, 0.08)), PossiblePlace(0.3, (0.5, 0.2)))


def test_where_it_is_crowded_things_stand_closer() -> None:
    crowd = [(0.3 + 0.14 * column, 0.14 * row) for column in range(-3, 4) for row in range(-4, 5)]
    pose = place_on_table("cube_0", world((0.4, 0.0), *crowd), CONFIG)
    nearest = min(math.dist(pose.t[:2], place) for place in crowd)
    assert 2 * 0.0282 + CONFIG.least_clearance <= nearest < 2 * 0.0282 + CONFIG.clearance


def test_a_full_table_has_no_place() -> None:
    small = KnownSolid((0.1, 0.1, 0.03), Pose((0.4, 0.0, 0.1)))
    with pytest.raises(NoPlace, match="there is no room on table for cube_0"):
        place_on_table("cube_0", world((0.4, 0.0), (0.4, 0.0), table=small), CONFIG)


def test_without_a_table_or_a_size_there_is_no_place() -> None:
    state = world((0.4, 0.0))
    with pytest.raises(NoPlace, match="a table is not known"):
        place_on_table("cube_0", replace(state, table=None), CONFIG)
    with pytest.raises(NoPlace, match="its size or pose is not known"):
        place_on_table("cube_9", state, CONFIG)


def test_the_turn_about_the_vertical_is_kept_and_a_tilt_is_not() -> None:
    turned = Pose.from_rotvec((0.4, 0.0, 0.12), (0.0, 0.0, 0.6))
    tilted = Pose.from_rotvec((0.4, 0.0, 0.12), (0.7, 0.0, 0.0))
    for pose, expected in ((turned, 0.6), (tilted, 0.0)):
        state = world((0.4, 0.0))
        state = replace(state, solids={**state.solids, "cube_0": KnownSolid(SIZE, pose)})
        assert place_on_table("cube_0", state, CONFIG).rotvec.tolist() == pytest.approx([0.0, 0.0, expected])


def test_each_step_becomes_a_skill_and_places_do_not_collide() -> None:
    state = world((0.42, 0.08), (0.42, 0.08), (0.42, 0.08))
    steps = (
        PlanStep("pick", "cube_2"), PlanStep("putdown", "cube_2", "table"), PlanStep("pick", "cube_1"),
        PlanStep("putdown", "cube_1", "table"), PlanStep("pick", "cube_0"), PlanStep("stack", "cube_0", "cube_2"),
    )  # fmt: skip
    skills = ground(steps, state, CONFIG)
    assert [str(skill) for skill in skills] == [
        "pick cube_2", "place cube_2 on table", "pick cube_1", "place cube_1 on table", "pick cube_0",
        "place cube_0 on cube_2",
    ]  # fmt: skip
    one, two = skills[1].target_pose, skills[3].target_pose
    assert one is not None and two is not None and math.dist(one.t[:2], two.t[:2]) > 0.1
    assert [skill.target_pose is None for skill in skills] == [True, False, True, False, True, True]


def test_stacked_is_in_the_middle_of_the_support() -> None:
    state = world((0.42, 0.08), (0.3, 0.1))
    pose = stacked("cube_0", "cube_1", state)
    assert pose is not None and pose.t == pytest.approx((0.3, 0.1, 0.16))
    assert stacked("cube_0", "cube_9", state) is None


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock()
    memory = Memory("test", "reader", transport=LocalNetwork(clock).connect("reader"), clock=clock)
    set_table(memory)
    return memory


def test_the_state_is_read_from_the_graph(memory: Memory) -> None:
    memory.add_node("camera_overhead", "camera", fx=600.0, fy=600.0, cx=319.5, cy=239.5, width=640, height=480)
    memory.add_edge("world", "camera_overhead", "RT", pose=DOWN)
    memory.add_node("camera_wrist", "camera", fx=600.0, fy=600.0, cx=319.5, cy=239.5, width=640, height=480)
    memory.add_node("arm", "arm")
    memory.add_edge("world", "arm", "RT", pose=Pose((-0.1, 0.2, 0.0)))
    memory.add_node("ball_1", "ball", size=(0.06, 0.06, 0.06))
    memory.add_edge("world", "ball_1", "Virtual_RT", pose=Pose((0.5, 0.3, 0.03)))
    memory.add_node("crate", "box", size=(0.3, 0.2, 0.1))
    memory.add_edge("world", "crate", "Virtual_RT", pose=Pose((0.6, -0.3, 0.05)))
    memory.add_node("cube_9", "cube")
    memory.add_edge("world", "cube_9", "Virtual_RT", pose=Pose((0.6, 0.3, 0.02)))
    memory.add_node("cube_8", "cube", size=SIZE)
    state = read_state(memory, CONFIG)
    cubes = {"cube_3", "cube_4", "cube_5", "cube_6"}
    assert state.relations.things == cubes | {"ball_1", "crate", "cube_9"}
    assert state.graspable == cubes | {"ball_1"}
    assert state.flat == cubes | {"crate", "cube_9"}
    assert state.table == "table" and state.arms["arm"].base == (-0.1, 0.2)
    assert set(state.solids) == cubes | {"ball_1", "crate", "table"}
    [view] = state.views
    assert view.sees(np.array([(0.35, 0.0, 0.04), (0.8, 0.0, 0.04), (0.35, 0.0, 0.8)]), 0.2).tolist() == [
        True, False, False,
    ]  # fmt: skip


def test_things_go_on_the_table_that_carries_most(memory: Memory) -> None:
    memory.add_node("a_desk", "table", size=(1.0, 1.0, 0.03))
    memory.add_edge("world", "a_desk", "RT", pose=Pose((2.0, 0.0, 0.0)))
    assert read_state(memory, CONFIG).table == "table"


def test_a_distribution_whose_first_places_are_impossible_is_read_all_the_same() -> None:
    with Run() as run:
        impossible = [Alternative(weight=0.0, pose=Pose((0.3, 0.01 * number, 0.02))) for number in range(9)]
        likely = [Alternative(weight=share, pose=Pose((0.4, share, 0.02))) for share in (0.4, 0.6)]
        believe(run.memory, "cube_3", *impossible, *likely)
        found = read_state(run.memory, PlannerConfig()).doubts["cube_3"]
    assert [doubt.probability for doubt in found[:2]] == pytest.approx([0.6, 0.4])


def test_what_is_removed_while_the_state_is_read_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    with Run() as run:
        memory = run.memory
        read = memory.get_transform

        def remove_then(*names: str, **options: Any) -> Pose | None:
            pose = read(*names, **options)
            if "cube_3" in names and "cube_3" in memory:
                memory.remove_node("cube_3")
            return pose

        monkeypatch.setattr(memory, "get_transform", remove_then)
        state = read_state(memory, PlannerConfig())
        assert "cube_3" in state.solids and "cube_3" not in state.doubts
        alternative = Alternative(weight=1.0, pose=Pose(), containers=("cup",))
        assert Covers(memory, PlannerConfig()).cover_of("cube_3", alternative) == ""
