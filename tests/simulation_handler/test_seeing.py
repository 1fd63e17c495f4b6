"""Edges `sees` that the simulation handler writes, and the cameras and obstacles that it finds in the graph."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from msgspec.json import encode

from agents.perspectives import Visibility
from dsr.math3d.transforms import Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.visibility import is_seen, visibility
from dsr.vocabulary.calibration import PROVISIONAL, STEADY, SURPRISE, Report, request_calibration
from dsr.vocabulary.perceived import MOST_CAMERAS, camera_nodes
from simulation_handler import SimulationHandler
from simulation_handler.graph_io import seeing
from simulation_handler.graph_io.views import by_color, obstacles, views
from simulation_handler.perception.visibility import CameraView, RayVisibility
from surprise.config import SurpriseConfig
from surprise.expectation import Expectations
from tests.simulation_handler.test_agent import NAME, OVERHEAD, Table
from tests.simulation_handler.worlds import CUBE, cube_at

LENS = {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5, "width": 640, "height": 480}


@pytest.fixture
def table() -> Iterator[Table]:
    scene = Table()
    scene.memory.update_node("camera", **LENS)
    yield scene
    scene.lockstep.close()


def seen(table: Table) -> dict[str, tuple[float, str]]:
    """How much of the tag of each cube the camera should see, and what hides most of it."""
    edges = table.memory.edges("sees", src="camera")
    return {edge.dst: (edge["detectable"], edge["covered_by"]) for edge in edges}


def add_arm(table: Table, x: float, y: float) -> None:
    table.memory.add_node("link", "body", bounds=(-0.04, -0.04, -0.1, 0.04, 0.04, 0.1))
    table.memory.add_edge("world", "link", "RT", pose=Pose((x, y, 0.4)))


def test_what_is_in_view_below_another_and_below_the_arm(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, 0.1, 0.06))
    table.add("cube_3", cube_at(0.3, -0.1))
    table.run(2.0)
    assert seen(table) == {"cube_1": (0.0, "cube_2"), "cube_2": (1.0, ""), "cube_3": (1.0, "")}
    add_arm(table, 0.32, -0.06)
    table.run(0.3)
    share, covered_by = seen(table)["cube_3"]
    assert share < 1.0 and covered_by == "link"


def test_what_has_a_tag_is_recognised_by_its_colour_while_it_is_seen_by_that(table: Table) -> None:
    table.memory.add_node("cube_3", "cube", size=CUBE, color=(0.9, 0.1, 0.1), marker_id=3)
    table.memory.add_node("cube_4", "cube", size=CUBE, color=(0.1, 0.9, 0.1), marker_id=4)
    table.memory.add_node("ball", "ball", size=CUBE, color=(0.1, 0.1, 0.9))
    assert by_color(table.memory) == {"ball"}
    table.memory.add_node("old", "camera")
    colored = {"ball", "cube_3"}
    for stamp, std, found in ((1.0, math.pi, colored), (2.0, 0.05, {"ball"}), (3.0, math.pi, colored)):
        pose = Pose((0.0, 0.0, 0.5), stamp=stamp, covariance=np.diag([1e-6] * 3 + [std**2] * 3))
        table.memory.add_edge("camera", "cube_3", "RT", pose=pose)
        assert by_color(table.memory) == found
    by_tag = Pose((0.0, 0.0, 0.5), stamp=2.5, covariance=1e-6 * np.eye(6))
    table.memory.add_edge("old", "cube_3", "RT", pose=by_tag)
    assert by_color(table.memory) == colored


def test_cameras_and_what_hides_are_made_ready_anew_only_when_they_changed(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def make(cameras: Sequence[CameraView], *others: Any, **options: Any) -> RayVisibility:
        made.append([camera.camera for camera in cameras])
        return RayVisibility(cameras, *others, **options)

    table.add("cube_3", cube_at(0.3, -0.1))
    table.run(2.0)
    monkeypatch.setattr(seeing, "RayVisibility", make)
    table.run(1.0)
    assert made == [] and seen(table)["cube_3"] == (1.0, "")
    add_arm(table, 0.32, -0.06)
    table.run(0.5)
    assert made == [["camera"]] * 2 and seen(table)["cube_3"][1] == "link"


def test_an_arm_at_rest_trembles_and_changes_nothing(table: Table, monkeypatch: pytest.MonkeyPatch) -> None:
    table.add("cube_3", cube_at(0.3, -0.1))
    add_arm(table, 0.32, -0.06)
    table.run(2.0)
    monkeypatch.setattr(seeing, "RayVisibility", lambda *_, **__: pytest.fail("made ready anew"))
    camera = table.memory.get_pose("world", "camera", "RT")
    assert camera is not None
    for step in range(1, 6):
        add_arm(table, 0.32 + 1e-12 * step, -0.06)
        x, y, z = camera.t
        table.memory.add_edge("world", "camera", "RT", pose=Pose((x + 1e-9 * step, y, z), camera.q, camera.stamp))
        table.run(0.2)
    assert seen(table)["cube_3"][1] == "link"


def test_what_the_arm_hides_if_a_camera_did_not_move_but_all_objects(table: Table) -> None:
    memory, shift = table.memory, Pose((0.0, -0.12, 0.0))
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.3, -0.1))
    add_arm(table, 0.32, 0.06)
    table.run(1.0)
    assert seen(table)["cube_2"] == (1.0, "")
    after, before = OVERHEAD, shift.inverse() @ OVERHEAD
    told = Report(
        *("camera", "world", "robust", True, "", pose7(before), pose7(after), (), 0.1, 0.0, 1, False, 1, 2, 2, ()),
        provisional=True,
    )
    memory.update_node(request_calibration(memory, "camera"), source=SURPRISE, report=encode(told).decode())
    memory.update_node("camera", mount=PROVISIONAL)
    table.run(0.3)
    share, covered_by = seen(table)["cube_2"]
    assert share < 1.0 and covered_by == "link"
    memory.update_node("camera", mount=STEADY)
    table.run(0.3)
    assert seen(table)["cube_2"] == (1.0, "")


def pose7(pose: Pose) -> tuple[float, ...]:
    return (*pose.t, *pose.q)


def test_what_may_be_outside_the_image_is_not_expected_of_a_camera_whose_pose_is_uncertain(table: Table) -> None:
    table.add("cube_1", cube_at(0.35, 0.22))
    table.run(2.0)
    assert seen(table) == {"cube_1": (1.0, "")}
    covariance = np.diag([0.005, 0.005, 0.005, 0.02, 0.02, 0.02]) ** 2
    table.memory.update_edge("world", "camera", "RT", pose=OVERHEAD.with_covariance(covariance))
    table.run(0.3)
    assert seen(table) == {"cube_1": (0.0, "")}


def test_it_is_quiet_and_ends_with_the_object_and_the_camera(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.3, -0.1))
    table.run(2.0)
    watch = table.memory.watch(edge_type="sees", existing=False)
    table.run(3.0)
    assert watch.poll() == []
    del table.truths["cube_2"]
    table.memory.remove_node("cube_2")
    table.run(0.5)
    assert set(seen(table)) == {"cube_1"}
    table.memory.update_node("camera", fx=0.0)
    table.run(0.5)
    assert seen(table) == {}


def test_edges_are_compared_only_where_the_answer_changed_and_one_that_was_removed_comes_back(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.3, -0.1))
    table.run(2.0)
    compared: list[tuple[str, str]] = []
    is_news = seeing._is_news
    monkeypatch.setattr(
        seeing, "_is_news", lambda written, *of: (compared.append(written.key[:2]), is_news(written, *of))[1]
    )
    table.run(1.0)
    assert compared == []
    table.memory.remove_edge("camera", "cube_2", "sees")
    table.run(0.3)
    assert set(seen(table)) == {"cube_1", "cube_2"}
    add_arm(table, 0.32, -0.06)
    table.run(0.5)
    assert {name for _, name in compared} == {"cube_2"} and seen(table)["cube_2"][1] == "link"


def test_an_edge_that_somebody_else_changes_is_put_right(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    table.memory.update_edge("camera", "cube_1", "sees", share=0.0, visible=False, hidden_by="ghost")
    table.run(0.3)
    edge = table.memory.edge("camera", "cube_1", "sees")
    assert (edge["share"], edge["visible"], edge["hidden_by"]) == (1.0, True, "")


def test_it_goes_on_after_a_restart(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    before = seen(table)
    table.lockstep.kill("simulation_handler")
    table.run(0.5)
    assert seen(table) == before == {"cube_1": (1.0, "")}
    table.lockstep.restart("simulation_handler")
    table.run(0.5)
    assert seen(table) == before


def test_unusable_cameras_and_parts_are_left_out(table: Table) -> None:
    memory = table.memory
    add_arm(table, 0.3, 0.0)
    memory.add_node("lost", "body", bounds=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    memory.add_node("inside_out", "gripper", bounds=(1.0, 0.0, 0.0, 0.0, 1.0, 1.0))
    memory.add_edge("world", "inside_out", "RT", pose=Pose())
    memory.add_node("blind", "camera")
    memory.add_node("nowhere", "camera", **LENS)
    assert [view.camera for view in views(memory)] == ["camera"]
    found = {solid.name: solid for solid in obstacles(memory)}
    assert set(found) == {"link", "table"}
    assert found["link"].position == pytest.approx((0.3, 0.0, 0.4))
    assert found["table"].top == pytest.approx(0.0)


def add_hand(table: Table, x: float, y: float, z: float) -> None:
    """A hand over the table, palm down."""
    now = table.lockstep.clock.now()
    table.memory.add_node("human_hand_0", "hand", perceived=True, last_seen=now, side="right")
    table.memory.add_edge("world", "human_hand_0", "RT", pose=Pose((x, y, z)).with_stamp(now))


def test_a_hand_hides_what_is_below_it_as_long_as_somebody_sees_it(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.3, -0.1))
    table.run(2.0)
    add_hand(table, 0.37, 0.09, 0.2)
    table.run(0.3)
    assert seen(table)["cube_1"] == (0.0, "human_hand_0")
    assert seen(table)["cube_2"] == (1.0, "")
    table.run(1.5)
    assert seen(table)["cube_1"] == (1.0, "")


def test_what_persons_see_is_told_by_others(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    table.memory.add_node("human_1", "person")
    table.memory.add_edge("human_1", "cube_1", "sees", share=1.0)
    table.run(0.5)
    assert len(table.memory.edges("sees", src="human_1")) == 1 and set(seen(table)) == {"cube_1"}


@pytest.fixture
def crowded(table: Table) -> Table:
    """Cubes on, beside and behind each other, beneath the arm, at the image's border, and somebody who leans over one.

    A second camera looks from the side, through a lens that is not as wide.
    """
    places = {"on": (0.4, 0.1, 0.06), "beneath": (0.4, 0.1, 0.02), "free": (0.3, 0.1, 0.02), "arm": (0.3, -0.1, 0.02)}
    places |= {"border": (0.35, 0.255, 0.02), "person": (0.5, -0.12, 0.02), "behind": (0.36, 0.13, 0.02)}
    for name, place in places.items():
        table.add(name, cube_at(*place))
    add_arm(table, 0.31, -0.06)
    table.memory.add_node("camera_side", "camera", **{**LENS, "fx": 900.0, "fy": 900.0})
    side = Pose.from_rotvec((0.35, -0.6, 0.25), (-2.0, 0.0, 0.0))
    table.memory.add_edge("world", "camera_side", "RT", pose=side)
    table.memory.add_node("human_1", "person", perceived=True, last_seen=table.lockstep.clock.now() + 3.0)
    table.memory.add_edge("world", "human_1", "RT", pose=Pose((0.6, -0.2, 0.4)))
    table.run(2.5)
    return table


def test_shares_are_those_of_pictures_and_so_is_what_counts_as_visible(crowded: Table) -> None:
    """One meaning, whoever writes an edge: how much of the image of a thing is seen, as drawn by `dsr.visibility`."""
    memory = crowded.memory
    drawn = visibility(memory)
    edges = {(edge.src, edge.dst): edge for edge in memory.edges("sees")}
    cameras = ("camera", "camera_side")
    assert edges.keys() == {key for key in drawn if key[0] in cameras}
    for key, edge in edges.items():
        assert edge["share"] == pytest.approx(drawn[key].share, abs=0.1), key
        assert edge["visible"] == is_seen(drawn[key]), key
        assert edge["hidden_by"] == drawn[key].hidden_by or edge["share"] > 0.0, key
    shares = {edge["share"] for edge in edges.values()}
    assert min(shares) == 0.0 and max(shares) == 1.0 and any(0.2 < share < 0.8 for share in shares)
    assert edges["camera", "person"]["hidden_by"] == edges["camera", "person"]["covered_by"] == "human_1"


def test_what_can_be_recognised_is_told_apart_from_what_is_seen(crowded: Table) -> None:
    edge = crowded.memory.edge("camera_side", "beneath", "sees")
    assert edge["share"] > 0.2 and edge["visible"] is True, "its sides are seen"
    assert (edge["detectable"], edge["covered_by"]) == (0.0, "on"), "its tag is not"


def test_who_draws_pictures_from_cameras_leaves_edges_alone_that_tell_more() -> None:
    specs = [AgentSpec(NAME, SimulationHandler), AgentSpec("visibility", Visibility, {"kinds": ["camera", "person"]})]
    with Lockstep(specs, strict=True) as lockstep:
        memory = lockstep.memory
        memory.add_node("world", "world")
        memory.add_node("camera", "camera", **LENS)
        memory.add_node("unknown", "camera", fov=(1.0, 0.8))
        for camera in ("camera", "unknown"):
            memory.add_edge("world", camera, "RT", pose=OVERHEAD)
        for name, x in (("cube_1", 0.35), ("cube_2", 3.0)):
            memory.add_node(name, "cube", size=CUBE, mass=0.05)
            memory.add_edge("world", name, "Virtual_RT", pose=Pose((x, 0.0, 0.02)))
        memory.flush()
        lockstep.run_for(1.0)
        watch = memory.watch(edge_type="sees", existing=False)
        lockstep.run_for(2.0)
        assert not watch.poll(), "nobody undoes what another one writes"
        edges = {(edge.src, edge.dst): edge for edge in memory.edges("sees")}
        assert edges.keys() == {("camera", "cube_1"), ("camera", "cube_2"), ("unknown", "cube_1")}
        assert all(("detectable" in edge) == (edge.src == "camera") for edge in edges.values())
        assert edges["unknown", "cube_1"]["visible"] is edges["camera", "cube_1"]["visible"] is True


def test_a_camera_that_moves_recognises_nothing_and_is_no_witness_of_absence(table: Table) -> None:
    """It comes along at 0.2 m/s, and sees the cube the whole time; its frames are not used. Then it stands."""
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    assert seen(table) == {"cube_1": (1.0, "")}
    table.truths.clear()  # what its frames show is not published
    for step in range(1, 21):
        table.memory.add_edge("world", "camera", "RT", pose=OVERHEAD @ Pose((0.0, 0.02 * (step % 5), 0.0)))
        table.run(0.1)
        assert step < 3 or seen(table) == {"cube_1": (0.0, "")}
    edge = table.memory.edge("camera", "cube_1", "sees")
    assert edge["share"] == 1.0 and edge["visible"] is True, "it is in view all the same"
    where = table.memory.belief("cube_1")
    assert where is not None and where.gone < 0.05
    table.run(0.5)
    assert seen(table) == {"cube_1": (1.0, "")}


def test_however_many_cameras_somebody_makes_up_few_are_looked_through_and_those_of_others_stay(table: Table) -> None:
    liar = table.lockstep._join("liar", "liar-1", None)
    for number in range(MOST_CAMERAS + 9):
        liar.add_node(f"a_{number}", "camera", **LENS)
        liar.add_edge("world", f"a_{number}", "RT", pose=OVERHEAD)
    liar.flush()
    table.run(0.2)
    memory = table.memory
    assert len(camera_nodes(memory)) == len(views(memory)) == MOST_CAMERAS
    expectations = Expectations(memory, SurpriseConfig())
    expectations.update(0.0, (), ())
    assert len(expectations._cameras) == MOST_CAMERAS
    assert "camera" in {view.camera for view in views(memory)} & expectations._cameras.keys()
