"""What comes into view after a camera was put right puts it right further, unless it was moved meanwhile."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dsr.math3d.transforms import Pose
from dsr.timeline import EXPLAINED, Chronicle
from dsr.vocabulary.calibration import CALIBRATED, STEADY
from dsr.vocabulary.explained import CAMERA_MOVED, ExplainedChange, encoded
from tests.agents.calibrator.scenes import BUMP, DOWN, Stage, cubes

HIDDEN = ("cube_4", "cube_5", "cube_6")
PLACES = ((-0.1, -0.12), (0.11, -0.1), (0.1, 0.12), (-0.12, 0.1), (0.16, 0.0), (-0.14, 0.0))


@pytest.fixture
def stage() -> Iterator[Stage]:
    """A camera that was bumped and put right by three of six cubes, one of which it sees 4 mm off."""
    stage = Stage(objects=cubes(PLACES))
    stage.memory.add_edge("world", "camera", "RT", pose=DOWN)
    stage.look(2.0)
    everything = stage.objects
    stage.objects = {name: pose for name, pose in everything.items() if name not in HIDDEN}
    stage.seen_off = {"cube_1": Pose((0.004, 0.0, 0.0))}
    stage.parent_from_camera = DOWN @ BUMP
    stage.look(0.8)
    Chronicle(stage.memory, "simulation_handler").happened(
        EXPLAINED, tuple(stage.objects), text="the camera moved", changes=encoded((ExplainedChange(CAMERA_MOVED),))
    )
    stage.look(2.0)
    assert stage.memory.node("camera")["mount"] == STEADY and events(stage) == 1
    stage.objects = everything
    yield stage
    stage.lockstep.close()


def events(stage: Stage) -> int:
    return len(Chronicle(stage.memory).query(kind=CALIBRATED))


def test_further_objects_put_it_right_further(stage: Stage) -> None:
    before = stage.error[0]
    stage.look(1.5)
    assert events(stage) == 2 and stage.error[0] < 0.6 * before


def test_what_was_moved_meanwhile_does_not(stage: Stage) -> None:
    written = stage.memory.edge("world", "camera", "RT")["pose"]
    stage.objects = {
        name: Pose((0.02 * int(name[-1]) - 0.1, 0.03, 0.0)) @ pose if name in HIDDEN else pose
        for name, pose in stage.objects.items()
    }
    stage.look(1.5)
    assert stage.memory.edge("world", "camera", "RT")["pose"] is written and events(stage) == 1


def test_nor_what_comes_long_afterwards(stage: Stage) -> None:
    stage.wait(31.0)
    stage.look(1.5)
    assert events(stage) == 1
