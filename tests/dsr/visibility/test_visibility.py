"""Who sees what in a world, at once and followed over time."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dsr import ConfigError, ManualClock, Memory, Mesh, Pose
from dsr.visibility import (
    LEAST_SHARE,
    VisibilityMonitor,
    bodies_of,
    intrinsics_of,
    is_seen,
    read_perspectives,
    read_posed,
    visibility,
)


def seen(memory: Memory) -> set[tuple[str, str]]:
    return {key for key, visible in visibility(memory).items() if is_seen(visible)}


def test_a_box_hides_a_cube_from_the_person_on_the_other_side(memory: Memory) -> None:
    assert seen(memory) == {
        ("camera", "box"), ("camera", "cube"), ("human_1", "box"), ("human_1", "cube"), ("human_2", "box"),
    }  # fmt: skip
    assert visibility(memory)["human_2", "cube"].hidden_by == "box"


def test_only_of_the_perspectives_that_are_asked_for(memory: Memory) -> None:
    assert {name for name, _ in visibility(memory, ["human_2"])} == {"human_2"}
    with pytest.raises(ConfigError, match="human_2"):
        visibility(memory, ["human_3"])


def test_who_is_not_there_any_more_sees_nothing(memory: Memory, clock: ManualClock) -> None:
    memory.update_node("human_1", perceived=False)
    memory.update_node("human_2", perceived=True, last_seen=clock.now())
    assert [view.name for view in read_perspectives(memory)] == ["camera", "human_2"]
    clock.advance(5.0)
    assert [view.name for view in read_perspectives(memory)] == ["camera"]


def test_what_has_left_the_scene_or_is_nowhere_is_not_seen(memory: Memory) -> None:
    memory.update_node("cube", present=False)
    memory.add_node("lost", "cube", size=(0.04, 0.04, 0.04))
    assert {thing for _, thing in visibility(memory)} == {"box"}


def test_where_a_thing_is_believed_to_be_counts(memory: Memory) -> None:
    memory.add_edge("world", "cube", "Virtual_RT", pose=Pose((-0.1, 0.0, 0.02)))
    assert {name for name, thing in seen(memory) if thing == "cube"} == {"camera", "human_2"}


def test_parts_of_a_robot_hide_things(memory: Memory) -> None:
    memory.add_node("arm", "arm", bounds=(-0.3, -0.3, 0.0, 0.3, 0.3, 0.05))
    memory.add_edge("world", "arm", "RT", pose=Pose((0.0, 0.0, 0.4)))
    assert visibility(memory)["camera", "cube"].hidden_by == "arm"


PANEL = Mesh([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)], [(0, 1, 2), (0, 2, 3)])


@pytest.mark.parametrize("attributes", [{}, {"bounds": (0.0, -1.0, -1.0, 0.0, 1.0, 1.0)}], ids=["mesh", "bounds"])
def test_a_flat_mesh_hides_what_is_behind_it(memory: Memory, attributes: dict[str, Any]) -> None:
    memory.add_node("panel", "object", mesh=memory.put_mesh(PANEL), **attributes)
    memory.add_edge("world", "panel", "RT", pose=Pose((0.3, 0.0, 0.2)))
    assert visibility(memory)["human_1", "cube"].hidden_by == "panel"
    assert ("human_1", "panel") in seen(memory)


def test_a_flat_mesh_that_is_elsewhere_is_the_box_around_it(memory: Memory) -> None:
    memory.add_node("panel", "object", mesh="0" * 64, bounds=(0.0, -1.0, -1.0, 0.0, 1.0, 1.0))
    memory.add_edge("world", "panel", "RT", pose=Pose((0.3, 0.0, 0.2)))
    assert visibility(memory)["human_1", "cube"].hidden_by == "panel"


def test_a_thing_of_a_mesh_without_size_is_seen_and_hides(memory: Memory) -> None:
    memory.add_node("slab", "cube", mesh=memory.put_mesh(PANEL))
    memory.add_edge("world", "slab", "RT", pose=Pose((0.3, 0.0, 0.2)))
    assert ("human_1", "slab") in seen(memory)
    assert visibility(memory)["human_1", "cube"].hidden_by == "slab"


@pytest.mark.parametrize("bounds", [(0.0, -1.0, -1.0, 0.0, 1.0, 1.0), (1.0, -1.0, -1.0, 0.0, 1.0, 1.0)])
def test_bounds_without_a_mesh_need_an_inside(memory: Memory, bounds: tuple[float, ...]) -> None:
    memory.add_node("arm", "arm", bounds=bounds)
    memory.add_edge("world", "arm", "RT", pose=Pose((0.3, 0.0, 0.2)))
    assert ("human_1", "cube") in seen(memory)


def test_a_nodes_field_of_view_is_that_of_its_pictures(memory: Memory) -> None:
    memory.update_node("human_1", fov=(math.radians(90.0), math.radians(60.0)))
    intrinsics = intrinsics_of(memory.node("human_1"), 200)
    assert (intrinsics.width, intrinsics.fx) == (200, pytest.approx(100.0))
    assert intrinsics.height == round(200.0 * math.tan(math.radians(30.0)))
    half = intrinsics_of(memory.node("camera"), 160)
    assert (half.width, half.height, half.fx, half.cx) == (160, 120, 150.0, 79.5)


@pytest.mark.parametrize("width", [-5, 0, 1_000_000])
def test_a_width_that_no_picture_has_is_refused(memory: Memory, width: int) -> None:
    with pytest.raises(ConfigError, match=f"width {width}: expected 1 to 4096 px"):
        visibility(memory, width=width)


@pytest.mark.parametrize(
    ("name", "fov", "message"),
    [("none", (0.0, 1.0), "positive"), ("below", (-1.0, 1.0), "positive"), ("wide", (6.0, 6.0), "at most 2.97 rad")],
)
def test_a_field_of_view_that_cannot_be_drawn_is_told_once(
    memory: Memory, caplog: pytest.LogCaptureFixture, name: str, fov: tuple[float, float], message: str
) -> None:
    memory.add_node(name, "person", fov=fov)
    memory.add_edge("world", name, "RT", pose=Pose((1.0, 0.0, 0.2)))
    for _ in range(2):
        visibility(memory, [name])
    (record,) = (record for record in caplog.records if record.name == "dsr.visibility")
    assert name in record.getMessage() and message in record.getMessage()


def test_a_narrow_view_misses_what_is_beside(memory: Memory) -> None:
    memory.update_node("human_1", fov=(0.2, 0.2))
    memory.add_edge("world", "human_1", "RT", pose=Pose.from_rotvec((1.0, 0.0, 0.2), (0.0, 0.0, math.pi - 0.4)))
    assert not {thing for name, thing in seen(memory) if name == "human_1"}


def test_the_monitor_tells_what_comes_into_sight_and_goes(memory: Memory) -> None:
    monitor = VisibilityMonitor(memory, ["human_2"])
    assert [(change.thing, change.seen) for change in monitor.update()] == [("box", True)]
    assert monitor.update() == [] and monitor.pictures == 1
    memory.add_edge("world", "cube", "RT", pose=Pose((-0.1, 0.3, 0.02)))
    [change] = monitor.update()
    assert (change.perspective, change.thing, change.seen) == ("human_2", "cube", True)
    assert change.visible.share == 1.0 and monitor.sees("human_2", "cube")
    memory.update_node("human_2", perceived=False)
    assert [(change.thing, change.seen) for change in monitor.update()] == [("box", False), ("cube", False)]
    assert monitor.perspectives == []


def test_what_is_seen_stays_so_until_it_clearly_is_not(memory: Memory) -> None:
    monitor = VisibilityMonitor(memory, ["human_2"], band=0.15, width=640)
    for height, expected in ((0.185, False), (0.196, True), (0.185, True), (0.179, False)):
        memory.add_edge("world", "cube", "RT", pose=Pose((0.1, 0.0, height)))
        monitor.update()
        assert monitor.sees("human_2", "cube") is expected, (height, monitor.visibilities["human_2", "cube"])
        share = monitor.visibilities["human_2", "cube"].share
        assert (share >= LEAST_SHARE) is (height == 0.196)


@pytest.mark.parametrize("pitch", [-1.2, 0.0, 0.9])
def test_the_trunk_of_a_person_stands_upright_wherever_they_look(memory: Memory, pitch: float) -> None:
    memory.add_node("guard", "person", perceived=True)
    turned = Pose.from_rotvec((0.3, 0.0, 1.5), (0.0, 0.0, 0.7)) @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, pitch, 0.0))
    memory.add_edge("world", "guard", "RT", pose=turned)
    head, trunk = (one for one in read_posed(memory) if one.name == "guard")
    assert head.matrix[:3, 0] == pytest.approx(turned.rotation_matrix[:, 0])
    assert trunk.matrix[:3, 2] == pytest.approx((0.0, 0.0, 1.0))
    assert trunk.matrix[:2, 0] == pytest.approx((math.cos(0.7), math.sin(0.7)))
    (body,) = (body for body in bodies_of(memory, read_posed(memory)) if body.name == "guard")
    assert len(body.solids.kinds) == 2
    memory.update_node("guard", perceived=False)
    assert "guard" not in [one.name for one in read_posed(memory)]
