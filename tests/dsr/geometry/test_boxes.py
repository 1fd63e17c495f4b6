"""Boxes around things: every corner of each, with all that is below, in any frame."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr import LocalNetwork, ManualClock, Memory, NodeNotFoundError, Pose
from dsr.geometry import Bounds, Mesh, bounding_box, own_bounds
from dsr.geometry.boxes import transformed
from tests.dsr.geometry.shapes import CORNERS, FACES

EIGHTH = (0.0, 0.0, math.sin(math.pi / 8), math.cos(math.pi / 8))  # 45 degrees about z


@pytest.fixture
def memory() -> Memory:
    memory = Memory("g", "m", transport=LocalNetwork(clock := ManualClock()).connect("m"), clock=clock)
    memory.add_node("world", "world")
    return memory


def add(memory: Memory, name: str, parent: str, pose: Pose, /, type: str = "object", **attributes: Any) -> None:
    memory.add_node(name, type, **attributes)
    memory.add_edge(parent, name, "RT", pose=pose)


def near(low: tuple[float, ...], high: tuple[float, ...]) -> Any:
    return (pytest.approx(low, abs=1e-9), pytest.approx(high, abs=1e-9))


def test_all_corners_count_not_just_two(memory: Memory) -> None:
    """Turned by 45 degrees about z, least and greatest corner alone would give a box without width."""
    add(memory, "a", "world", Pose((1.0, 0.0, 0.0), EIGHTH), size=(1.0, 1.0, 2.0))
    half = math.sqrt(0.5)
    assert bounding_box(memory, "a") == near((1 - half, -half, -1.0), (1 + half, half, 1.0))


def test_children_count_where_their_own_frames_put_them(memory: Memory) -> None:
    add(memory, "car", "world", Pose((0.0, 0.0, 5.0), EIGHTH), "group")
    add(memory, "axle", "car", Pose((1.0, 1.0, 0.0)), "group")
    add(memory, "wheel", "axle", Pose((0.0, 0.0, -1.0), EIGHTH), bounds=(0.0, 0.0, 0.0, 1.0, 2.0, 3.0))
    along = math.sqrt(2.0)  # from the car to the wheel, along y of the world; turned by 90 degrees in all
    expected = near((-2.0, along, 4.0), (0.0, along + 1.0, 7.0))
    for name in ("car", "axle", "wheel", "world"):
        assert bounding_box(memory, name) == expected
    assert bounding_box(memory, "car", children=False) is None
    assert bounding_box(memory, "wheel", "wheel") == ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    assert bounding_box(memory, "axle", "wheel") == near((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))


def test_a_belief_goes_before_a_percept(memory: Memory) -> None:
    add(memory, "camera", "world", Pose((9.0, 0.0, 0.0)), "camera")
    add(memory, "cup", "camera", Pose((1.0, 0.0, 0.0)), "cup", size=(2.0, 2.0, 2.0))
    memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((5.0, 0.0, 0.0)))
    assert bounding_box(memory, "cup") == near((4.0, -1.0, -1.0), (6.0, 1.0, 1.0))
    assert bounding_box(memory, "cup", types=("RT",)) == near((9.0, -1.0, -1.0), (11.0, 1.0, 1.0))
    assert bounding_box(memory, "camera") is None
    assert bounding_box(memory, "camera", types=("RT",)) is not None


def test_the_frame_of_a_table_is_on_top(memory: Memory) -> None:
    add(memory, "table", "world", Pose(), "table", size=(1.0, 2.0, 0.5))
    assert bounding_box(memory, "table") == ((-0.5, -1.0, -0.5), (0.5, 1.0, 0.0))


def test_meshes_tell_their_bounds_if_no_attribute_does(memory: Memory) -> None:
    mesh = Mesh(np.array(CORNERS) * (1, 2, 3), FACES)
    add(memory, "a", "world", Pose(), mesh=memory.put_mesh(mesh))
    assert bounding_box(memory, "a") == ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    add(memory, "b", "world", Pose(), mesh="0" * 64)
    assert bounding_box(memory, "b") is None
    memory.update_node("b", mesh="nonsense", size=(2.0, 2.0, 2.0))
    assert bounding_box(memory, "b", exact=True) == ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def test_exact_asks_the_vertices(memory: Memory) -> None:
    """A diamond, turned by 45 degrees, is narrower than its turned box."""
    diamond = Mesh([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)], [(0, 1, 2), (0, 2, 3)])
    bounds = (*diamond.bounds.low, *diamond.bounds.high)
    add(memory, "a", "world", Pose((0.0, 0.0, 0.0), EIGHTH), mesh=memory.put_mesh(diamond), bounds=bounds)
    half = math.sqrt(0.5)
    assert bounding_box(memory, "a") == near((-2 * half, -2 * half, 0.0), (2 * half, 2 * half, 0.0))
    assert bounding_box(memory, "a", exact=True) == near((-half, -half, 0.0), (half, half, 0.0))


def test_what_is_nowhere_has_no_box_and_loops_end(memory: Memory) -> None:
    memory.add_node("lost", "object", size=(1.0, 1.0, 1.0))
    assert bounding_box(memory, "lost") is None and own_bounds(memory, memory.node("lost")) is not None
    memory.add_node("other", "group")
    memory.add_edge("lost", "other", "RT", pose=Pose())
    elsewhere = memory.create_world("elsewhere")  # a cycle can only come from several writers
    for node in memory.nodes():
        elsewhere.add_node(node.name, node.type)
    assert memory.copy(elsewhere.add_edge("other", "lost", "RT", pose=Pose()))
    assert bounding_box(memory, "lost") is None
    assert bounding_box(memory, "lost", "lost") == ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    with pytest.raises(NodeNotFoundError):
        bounding_box(memory, "nobody")


numbers = st.floats(-3.0, 3.0)
triples = st.tuples(numbers, numbers, numbers)


@given(triples, triples, triples, st.tuples(numbers, numbers, numbers, numbers))
def test_the_box_holds_every_point_and_touches_all_sides(a: Any, b: Any, place: Any, turn: Any) -> None:
    if math.hypot(*turn) < 0.1:
        return
    pose = Pose(place, np.array(turn) / math.hypot(*turn))
    low, high = np.minimum(a, b), np.maximum(a, b)
    found = transformed(Bounds(tuple(low.tolist()), tuple(high.tolist())), pose)
    points = [low + np.array(share) * (high - low) for share in itertools.product((0.0, 0.3, 1.0), repeat=3)]
    placed = pose.apply(points)
    assert placed.min(axis=0) == pytest.approx(found.low, abs=1e-9)
    assert placed.max(axis=0) == pytest.approx(found.high, abs=1e-9)
