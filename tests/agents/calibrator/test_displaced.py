"""A camera that moved while most was hidden: what comes back is explained as moved, one by one, until that adds up."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import pytest

from agents.calibrator.solve.fusing import fuse
from dsr.math3d.transforms import Pose
from dsr.timeline import EXPLAINED, Chronicle
from dsr.vocabulary.calibration import ADOPTED, CALIBRATION, STEADY
from tests.agents.calibrator.scenes import BUMP, DOWN, Stage


@pytest.fixture
def stage() -> Iterator[Stage]:
    stage = Stage()
    stage.memory.add_edge("world", "camera", "RT", pose=DOWN)
    stage.look(2.0)
    yield stage
    stage.lockstep.close()


def come_back(stage: Stage, name: str, seconds: float = 1.2, told: str = "moved_alone({})") -> None:
    """An object alone comes into view, seems displaced, and is believed to have moved there by itself."""
    everything, stage.objects = stage.objects, {name: stage.objects[name]}
    stage.look(0.3)
    Chronicle(stage.memory, "simulation_handler").happened(EXPLAINED, (name,), text=told.format(name))
    seen = stage.memory.edge("camera", name, "RT")["pose"]
    stage.memory.add_edge("world", name, "Virtual_RT", pose=(DOWN @ seen).with_covariance(None))
    stage.look(seconds)
    stage.objects = everything


def put(stage: Stage, moved: Mapping[str, Pose]) -> None:
    stage.objects = {name: moved.get(name, Pose.identity()) @ pose for name, pose in stage.objects.items()}


def test_a_camera_that_was_bumped_unseen_is_found_out_by_what_comes_back(stage: Stage) -> None:
    stage.parent_from_camera = DOWN @ BUMP
    come_back(stage, "cube_1")
    assert stage.memory.nodes(CALIBRATION) == [], "one tells nothing"
    come_back(stage, "cube_2")
    stage.look(0.5)
    (request,) = stage.memory.nodes(CALIBRATION)
    assert request["status"] == ADOPTED
    assert stage.error[0] < 0.003 and stage.error[1] < math.radians(0.3)


def test_what_really_moved_one_by_one_does_not_add_up(stage: Stage) -> None:
    for number, way in enumerate([(0.03, 0.0), (-0.02, 0.02), (0.0, -0.03), (0.02, 0.03)], start=1):
        name = f"cube_{number}"
        put(stage, {name: Pose.from_rotvec((*way, 0.0), (0.0, 0.0, 0.2 * number))})
        come_back(stage, name)
    stage.look(1.0)
    assert stage.memory.nodes(CALIBRATION) == []
    assert stage.error[0] == 0.0 and stage.memory.node("camera").get("mount", STEADY) == STEADY


def test_what_is_put_alike_on_others_does_not_add_up(stage: Stage) -> None:
    """Two cubes are put on their neighbours, which are as far from either and hidden from then on."""
    way = Pose((-0.12, 0.0, 0.04))
    for name, below in (("cube_1", "cube_3"), ("cube_2", "cube_4")):
        put(stage, {name: way})
        come_back(stage, name, told=f"put_on({{}}, {below})")
    stage.look(1.0)
    assert stage.memory.nodes(CALIBRATION) == []
    assert stage.error[0] == 0.0 and stage.memory.node("camera").get("mount", STEADY) == STEADY


def test_what_something_carried_meanwhile_tells_nothing(stage: Stage) -> None:
    """Its belief from before is where it was in the gripper."""
    stage.memory.add_node("gripper", "gripper")
    stage.parent_from_camera = DOWN @ BUMP
    come_back(stage, "cube_1")
    stage.memory.add_edge("gripper", "cube_2", "grasping")
    stage.wait(0.5)
    stage.memory.remove_edge("gripper", "cube_2", "grasping")
    come_back(stage, "cube_2")
    assert stage.memory.nodes(CALIBRATION) == []
    come_back(stage, "cube_3")
    stage.look(0.5)
    assert stage.error[0] < 0.003, "what was seen before tells with what came later"


def test_what_was_displaced_long_ago_does_not_count(stage: Stage) -> None:
    stage.parent_from_camera = DOWN @ BUMP
    come_back(stage, "cube_1")
    stage.wait(61.0)
    come_back(stage, "cube_2")
    assert stage.memory.nodes(CALIBRATION) == []


def test_what_stands_still_is_not_fused_while_only_another_was_displaced(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fusing the percepts of one object takes milliseconds: a hundred of them take more than a tick."""
    fused = []

    def count(percepts: Sequence[Pose], *given: float) -> Pose:
        fused.append(len(percepts))
        return fuse(percepts, *given)

    monkeypatch.setattr("agents.calibrator.watch.views.fuse", count)
    put(stage, {"cube_1": Pose((0.03, 0.0, 0.0))})
    come_back(stage, "cube_1")
    fused.clear()
    ticks = 20
    stage.look(2.0)
    assert len(stage.objects) > 1 and len(fused) <= ticks, "the displaced one alone, at most once a tick"


def test_a_camera_that_hangs_from_two_frames_tells_nothing(stage: Stage) -> None:
    """Whoever may write poses can hang it elsewhere, too. Before, the tick failed."""
    stage.memory.add_node("shelf", "table")
    stage.memory.add_edge("shelf", "camera", "RT", pose=DOWN)
    stage.parent_from_camera = DOWN @ BUMP
    come_back(stage, "cube_1")
    come_back(stage, "cube_2")
    assert stage.memory.nodes(CALIBRATION) == []
