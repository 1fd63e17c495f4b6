"""Persons in the 3D view."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsr import Pose


def test_who_is_there_is_drawn_with_head_trunk_and_gaze(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table()
    stage.memory.add_node("human_1", "person", perceived=True)
    stage.memory.add_node("nowhere", "person", perceived=True)
    stage.memory.add_edge("world", "human_1", "RT", pose=Pose.from_rotvec((1.0, 0.0, 0.5), (0.0, 0.3, 0.0)))
    stage.run()
    stage.memory.update_node("human_1", perceived=False)
    stage.run()
    shown = stage.finish()
    centres = shown.values("/world/persons", "Boxes3D:centers")
    assert [len(boxes) for boxes in centres] == [2, 0]
    np.testing.assert_allclose(centres[0][1], (0.91, 0.0, -0.37), atol=1e-6)
    (gaze,) = shown.values("/world/persons/gazes", "Arrows3D:vectors")[0]
    np.testing.assert_allclose(gaze, (0.3 * np.cos(0.3), 0.0, -0.3 * np.sin(0.3)), atol=1e-3)
