"""What differs between two worlds."""

from __future__ import annotations

import math

from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.worlds.comparison import ChangedAttribute, ElementName, MovedEdge, MovedNode, Tolerance, difference

CUBE = ElementName("cube_1", "cube")


def worlds() -> tuple[Memory, Memory]:
    clock = ManualClock()
    base = Memory("g", "a", transport=LocalNetwork(clock).connect("a"), clock=clock)
    base.add_node("world", "world")
    base.add_node("cube_1", "cube", mass=1.0, size=(0.1, 0.1, 0.1))
    base.add_edge("world", "cube_1", "RT", pose=Pose((0.4, 0.0, 0.02), stamp=1.0))
    return base, base.fork("other")


def test_a_fork_is_equal_until_one_of_the_two_changes() -> None:
    base, other = worlds()
    assert difference(base, other).equal
    other.update_node("cube_1", via="base")
    other.update_edge("world", "cube_1", "RT", pose=Pose((0.4, 0.0, 0.02), stamp=2.0))
    assert difference(base, other).equal, "how and when it came does not count"
    other.add_node("cube_2", "cube")
    other.add_edge("world", "cube_2", "RT", pose=Pose())
    found = difference(base, other)
    assert found.only_second == [ElementName("cube_2", "cube")]
    assert not found.only_first and not found.equal
    other.remove_node("cube_2")
    other.remove_edge("world", "cube_1", "RT")
    found = difference(base, other)
    assert found.only_first == [ElementName("world cube_1", "RT")]
    assert found.nodes == [MovedNode("cube_1", math.inf, 0.0)]


def test_attributes_and_types() -> None:
    base, other = worlds()
    other.update_node("cube_1", mass=1.0 + 1e-12, friction=0.5)
    base.update_node("cube_1", perceived=True)
    found = difference(base, other)
    assert found.attributes == [
        ChangedAttribute(CUBE, "friction", None, 0.5), ChangedAttribute(CUBE, "perceived", True, None)
    ]  # fmt: skip
    assert difference(base, other, ignore=["friction", "perceived"]).equal
    other.remove_node("cube_1")
    other.add_node("cube_1", "box")
    assert difference(base, other).retyped == [(CUBE, ElementName("cube_1", "box"))]


def test_poses_have_a_tolerance_and_what_hangs_on_a_moved_frame_has_moved_too() -> None:
    base, other = worlds()
    for memory in (base, other):
        memory.add_node("camera", "camera")
        memory.add_edge("cube_1", "camera", "RT", pose=Pose((0.0, 0.0, 0.1)))
    other.update_edge("world", "cube_1", "RT", pose=Pose((0.4, 0.003, 0.024)))
    found = difference(base, other)
    (edge,) = found.edges
    assert edge.element == ElementName("world cube_1", "RT") and abs(edge.metres - 0.005) < 1e-9
    assert isinstance(edge, MovedEdge)
    assert [node.name for node in found.nodes] == ["camera", "cube_1"]
    assert difference(base, other, Tolerance(metres=0.0051)).equal
    other.update_edge("world", "cube_1", "RT", pose=Pose((0.4, 0.0, 0.02), (0.0, 0.0, math.sin(0.1), math.cos(0.1))))
    assert abs(difference(base, other).nodes[1].radians - 0.2) < 1e-9
