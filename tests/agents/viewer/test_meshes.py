"""Meshes in the 3D view: drawn once when they are here, moved with their node, gone with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.viewer import palette
from dsr import Pose
from tests.agents.viewer.test_viewer import rgba
from tests.dsr.geometry.shapes import block

ENTITY = "/world/meshes/shelf"


def put_shelf(stage: Any, **attributes: Any) -> None:
    stage.build_table("cube_3")
    stage.memory.add_node("shelf", "object", mesh=stage.memory.put_mesh(block()), **attributes)
    stage.memory.add_edge("world", "shelf", "RT", pose=Pose((1.0, 2.0, 3.0)))


def test_a_mesh_is_drawn_once_and_moves_with_its_node(stage: Any) -> None:
    stage.start_viewer()
    put_shelf(stage)
    stage.run()
    stage.memory.update_edge("world", "shelf", "RT", pose=Pose((1.0, 2.0, 4.0)))
    stage.run()
    shown = stage.finish()
    drawn = shown.values(f"{ENTITY}/0", "Mesh3D:vertex_positions")
    assert len(drawn) == 1
    np.testing.assert_array_equal(drawn[0], block().vertices)
    np.testing.assert_array_equal(shown.values(f"{ENTITY}/0", "Mesh3D:triangle_indices")[0], block().triangles)
    assert shown.values(f"{ENTITY}/0", "Mesh3D:albedo_factor")[0] == [rgba(palette.of_node("object"))]
    assert [place[0][2] for place in shown.values(ENTITY, "Transform3D:translation")] == [3.0, 4.0]


def test_its_node_may_have_a_colour(stage: Any) -> None:
    stage.start_viewer()
    put_shelf(stage, color=(1.0, 0.5, 0.0))
    stage.run()
    assert stage.finish().values(f"{ENTITY}/0", "Mesh3D:albedo_factor")[0] == [rgba((255, 128, 0))]


def test_what_is_shown_as_its_mesh_has_no_box(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.memory.update_node("cube_3", mesh=stage.memory.put_mesh(block()))
    stage.run()
    assert len(stage.finish().values("/world/beliefs", "Boxes3D:centers")[-1]) == 1


def test_it_is_gone_with_its_node_and_what_nobody_has_is_waited_for(stage: Any) -> None:
    stage.start_viewer()
    put_shelf(stage)
    stage.memory.add_node("ghost", "object", mesh="0" * 64)
    stage.memory.add_node("wrong", "object", mesh="nonsense")
    stage.memory.add_edge("world", "ghost", "RT", pose=Pose())
    stage.memory.add_edge("world", "wrong", "RT", pose=Pose())
    stage.run()
    stage.memory.remove_node("shelf")
    stage.run()
    shown = stage.finish()
    assert shown.values(ENTITY, "Clear:is_recursive") == [[True]]
    assert shown.values("/world/meshes/ghost/0", "Mesh3D:vertex_positions") == []
