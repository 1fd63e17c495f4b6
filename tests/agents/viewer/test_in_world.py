"""The viewer of another world shows that one, live, and waits for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from agents.viewer.in_world import WorldViewer
from dsr import Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec


def test_another_world_is_shown_as_soon_as_it_is_there(tmp_path: Path, shown: Callable[[Path], Any]) -> None:
    config = {"reads": ["idea"], "agent": {"folder": str(tmp_path)}}
    with Lockstep([AgentSpec("world_viewer", WorldViewer, config)], strict=True) as lockstep:
        memory = lockstep.memory
        memory.add_node("world", "world")
        memory.add_node("cube_3", "cube", size=(0.04, 0.04, 0.04))
        memory.add_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.1, 0.0, 0.02)))
        lockstep.run_for(1.0)
        idea = memory.fork("idea")
        idea.add_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.5, 0.0, 0.02)))
        lockstep.run_for(1.0)
    centres = shown(tmp_path / "recording.rrd").values("/world/beliefs", "Boxes3D:centers")
    np.testing.assert_allclose(centres[-1], [(0.5, 0.0, 0.02)], atol=1e-6)
    assert not any(np.allclose(boxes, [(0.1, 0.0, 0.02)]) for boxes in centres if len(boxes))
