"""What is shown of calibrations."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from agents.calibrator.solve.reporting import tell
from agents.calibrator.watch.undoing import turned_round
from agents.viewer.calibrations import calibrations_page
from dsr import Pose
from dsr.timeline import Chronicle
from dsr.vocabulary.calibration import ObjectReport, Report

BEFORE, AFTER = (0.1, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0), (0.12, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0)
OBJECTS = (
    ObjectReport("cube_3", 0.02, 0.01, 0.001, 0.0, is_outlier=False),
    ObjectReport("cube_4", 0.02, 0.01, 0.05, 0.5, is_outlier=True),
)


def report(*, adopted: bool = True) -> Report:
    return Report(
        *("camera", "world", "robust", adopted, "camera is 20.0 mm from where it was believed", BEFORE, AFTER, ()),
        *(0.02, 0.0, 100.0, False, 1, 2, 1, OBJECTS),
    )


def answer(stage: Any, found: Report) -> None:
    memory = stage.memory
    intrinsics = {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5, "width": 640, "height": 480}
    memory.add_node("world", "world")
    memory.add_node("camera", "camera", **intrinsics)
    memory.add_edge("world", "camera", "RT", pose=Pose(AFTER[:3], AFTER[3:]))
    memory.add_node("calibration_0", "calibration", report=msgspec.json.encode(found).decode())
    if found.adopted:
        tell(Chronicle(memory, "calibrator"), found)


def test_residuals_and_the_frustum_before_are_drawn(stage: Any) -> None:
    stage.start_viewer()
    answer(stage, report())
    stage.run()
    shown = stage.finish()
    np.testing.assert_allclose(
        shown.values("/world/cameras/camera_before", "Transform3D:translation")[-1][0], BEFORE[:3]
    )
    np.testing.assert_allclose(shown.values("/world/cameras/camera", "Transform3D:translation")[-1][0], AFTER[:3])
    for name, first in (("before", 0.8), ("after", 1.2)):
        places = shown.values(f"/series/residual_mm/camera/{name}", "BarChart:abscissa")[-1]
        np.testing.assert_allclose(places[0]["buffer"], (first, first + 1.0))
    assert "20.0 mm from where it was believed" in str(shown.values("/mind/calibrations", "TextDocument:text")[-1])


def test_a_pose_that_is_taken_back_is_drawn_as_well(stage: Any) -> None:
    stage.start_viewer()
    answer(stage, report())
    stage.run()
    tell(Chronicle(stage.memory, "calibrator"), turned_round(report(), "camera is where it was before after all"))
    stage.memory.add_edge("world", "camera", "RT", pose=Pose(BEFORE[:3], BEFORE[3:]))
    stage.run()
    shown = stage.finish()
    np.testing.assert_allclose(
        shown.values("/world/cameras/camera_before", "Transform3D:translation")[-1][0], AFTER[:3]
    )
    for name, heights in (("before", (1.0, 50.0)), ("after", (20.0, 20.0))):
        np.testing.assert_allclose(
            shown.values(f"/series/residual_mm/camera/{name}", "BarChart:values")[-1][0]["buffer"], heights
        )
    page = str(shown.values("/mind/calibrations", "TextDocument:text")[-1])
    assert page.index("where it was before after all") < page.index("20.0 mm from where it was believed")


def test_what_was_refused_moves_no_frustum(stage: Any) -> None:
    stage.start_viewer()
    answer(stage, report(adopted=False))
    stage.run()
    assert not stage.finish().values("/world/cameras/camera_before", "Transform3D:translation")


def test_the_page_tells_of_doubts_and_residuals(stage: Any) -> None:
    assert "Nothing was calibrated" in calibrations_page(stage.memory, [])
    stage.memory.add_node("camera", "camera", mount="in doubt", explanation="may have moved")
    page = calibrations_page(stage.memory, [report()])
    assert "**camera: in doubt** may have moved" in page
    assert r"| 1 | cube\_3 | 20.0 mm, 0.57° | 1.0 mm, 0.00° |" in page
    assert r"| 2 | cube\_4 (does not agree) |" in page
