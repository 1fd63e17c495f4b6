"""Models in the working memory: nodes under a node, updated when loaded again, refused when names are taken."""

from __future__ import annotations

import numpy as np
import pytest

from dsr import ConfigError, LocalNetwork, ManualClock, Memory, NodeNotFoundError, Pose, SchemaError
from dsr.geometry import Model, bounding_box, mesh_hashes, put_model
from dsr.geometry.model import Geometry, RawNode, to_model
from tests.dsr.geometry.shapes import CORNERS, FACES, block


@pytest.fixture
def memory() -> Memory:
    memory = Memory("g", "m", transport=LocalNetwork(clock := ManualClock()).connect("m"), clock=clock)
    memory.add_node("world", "world")
    memory.add_node("room", "group")
    memory.add_edge("world", "room", "RT", pose=Pose((0.0, 0.0, 1.0)))
    return memory


def chair(width: float = 1.0) -> Model:
    """A seat with a back on it."""
    piece = Geometry(np.array(CORNERS) * (width, 1.0, 1.0), np.array(FACES))
    lifted = np.eye(4)
    lifted[2, 3] = 1.0
    back = RawNode("back", lifted, [piece])
    return to_model([RawNode("seat", np.eye(4), [piece], [back]), RawNode("light")], "chair", np.eye(4))


def test_nodes_stand_where_the_model_has_them(memory: Memory) -> None:
    assert put_model(memory, chair(), under="room", at=Pose((5.0, 0.0, 0.0))) == ["chair", "seat", "light", "back"]
    assert [memory.node(name).type for name in ("chair", "seat", "back", "light")] == [
        "group", "object", "object", "group",
    ]  # fmt: skip
    assert memory.transform("world", "back").t == (5.0, 0.0, 2.0)
    assert mesh_hashes(memory.node("back")) == (block().hash,) and memory.mesh(block().hash) == block()
    assert memory.node("seat")["bounds"] == (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    assert bounding_box(memory, "chair") == ((5.0, 0.0, 1.0), (6.0, 1.0, 3.0))


def test_loaded_again_it_is_updated(memory: Memory) -> None:
    put_model(memory, chair())
    put_model(memory, chair(2.0), at=Pose((1.0, 0.0, 0.0)))
    assert len(memory.nodes()) == 6 and len(memory.edges("RT")) == 5
    assert bounding_box(memory, "chair") == ((1.0, 0.0, 0.0), (3.0, 1.0, 2.0))


def test_a_prefix_makes_room_for_another(memory: Memory) -> None:
    put_model(memory, chair())
    assert put_model(memory, chair(), prefix="other_")[0] == "other_chair"
    assert memory.get_edge("other_seat", "other_back", "RT") is not None


@pytest.mark.parametrize("name", ["seat", "back"])
def test_a_name_that_is_taken_is_told_and_nothing_is_written(memory: Memory, name: str) -> None:
    memory.add_node(name, "cube")
    before = len(memory.nodes())
    with pytest.raises(ConfigError, match=f"'{name}' is there already, a cube"):
        put_model(memory, chair())
    assert len(memory.nodes()) == before
    memory.remove_node(name)
    put_model(memory, chair(), under="room")
    with pytest.raises(ConfigError, match="under room"):
        put_model(memory, chair(), under="world")


def test_wrong_names_are_told(memory: Memory) -> None:
    with pytest.raises(NodeNotFoundError, match="roof"):
        put_model(memory, chair(), under="roof")
    with pytest.raises(SchemaError, match="unknown node type 'chair'"):
        put_model(memory, chair(), type="chair")
    with pytest.raises(SchemaError, match="name"):
        put_model(memory, chair(), prefix="a b/")


def test_a_thing_is_one_body_with_its_frame_in_the_middle(memory: Memory) -> None:
    assert put_model(memory, chair(), under="room", type="box") == ["chair"]
    node = memory.node("chair")
    assert node.type == "box" and node["size"] == (1.0, 1.0, 2.0) and len(mesh_hashes(node)) == 2
    assert memory.transform("world", "chair").t == (0.5, 0.5, 2.0)
    assert bounding_box(memory, "chair") == ((0.0, 0.0, 1.0), (1.0, 1.0, 3.0))


def test_a_table_has_its_frame_on_top(memory: Memory) -> None:
    put_model(memory, chair(), type="table")
    assert memory.transform("world", "chair").t == (0.5, 0.5, 2.0)
    assert bounding_box(memory, "chair") == ((0.0, 0.0, 0.0), (1.0, 1.0, 2.0))


def test_an_empty_world_gets_its_root() -> None:
    clock = ManualClock()
    with Memory("g", "a", transport=LocalNetwork(clock).connect("a"), clock=clock) as memory:
        assert put_model(memory, chair(), at=Pose((1.0, 0.0, 0.0)))[0] == "chair"
        assert memory.node("world").type == "world" and memory.transform("world", "chair").t == (1.0, 0.0, 0.0)


def test_more_meshes_than_a_node_can_have_are_refused(memory: Memory) -> None:
    pieces = [Geometry(np.array(CORNERS) * (1.0, 1.0, k), np.array(FACES)) for k in range(1, 258)]
    with pytest.raises(ConfigError, match="257 meshes; at most 256"):
        put_model(memory, to_model([RawNode("crowd", np.eye(4), pieces)], "crowd", np.eye(4)))
    assert "crowd" not in memory
