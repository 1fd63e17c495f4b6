"""Frames and nodes: each name belongs to exactly one of the other."""

from __future__ import annotations

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.names import FrameNames, frame_of, node_of

FRAMES = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=14)
NODES = st.text("ab2ef-._/", min_size=1, max_size=20).map(lambda text: text.replace("/", "-"))


@given(FRAMES | st.text("ab2ef-._/", min_size=1, max_size=20))
@example("a.b")
@example("a-2e-b")
@example("a-2d-2e--2d-b")
def test_a_frame_comes_back_from_its_node(frame: str) -> None:
    if not frame.lstrip("/"):
        return
    node = node_of(frame)
    assert re.fullmatch(r"[A-Za-z0-9_.\-]{1,128}", node)
    assert frame_of(node) == frame.lstrip("/")


@given(NODES)
@example(".base")
@example("-2f-base")
@example("a--b")
@example("a-0-b")
def test_a_node_comes_back_from_its_frame(node: str) -> None:
    assert node_of(frame_of(node)) == node


@given(FRAMES, FRAMES)
def test_no_two_frames_share_a_node(one: str, other: str) -> None:
    one, other = one.lstrip("/"), other.lstrip("/")
    if one and other and one != other:
        assert node_of(one) != node_of(other)


def test_common_frames_stay_readable() -> None:
    assert node_of("base_link") == "base_link"
    assert node_of("/robot1/base_link") == "robot1.base_link"
    assert frame_of("robot1.base_link") == "robot1/base_link"
    assert node_of("tag36h11:3") == "tag36h11-3a-3"


def test_the_frame_that_is_the_world_changes_places_with_a_frame_called_world() -> None:
    names = FrameNames("map")
    assert (names.node("map"), names.node("world"), names.node("odom")) == ("world", "map", "odom")
    assert (names.frame("world"), names.frame("map"), names.frame("odom")) == ("map", "world", "odom")
    assert FrameNames().node("world") == "world"


@pytest.mark.parametrize("frame", ["", "/", "//", "x" * 129, "ä" * 60])
def test_a_frame_that_can_have_no_node_is_refused(frame: str) -> None:
    with pytest.raises(RosMessageError):
        node_of(frame)


def test_invented_names_do_not_fill_memory() -> None:
    names = FrameNames()
    for i in range(25_000):
        names.node(f"frame_{i}")
    assert len(names._nodes) <= 10_000
