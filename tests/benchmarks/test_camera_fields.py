"""The picture of what cameras see: its outlines are what a camera's image shows, and the one in docs is up to date."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.plant.camera import OVERHEAD
from agents.scenario.format.scenario import CameraSpec
from benchmarks.camera_fields import FARTHEST, footprint, main
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

ROOT = Path(__file__).parents[2]
LENS = Intrinsics.from_fov(640, 480, 0.98)


@pytest.mark.parametrize("pose", [OVERHEAD, CameraSpec(position=(-0.9, 0.0, 0.78), look_at=(0.0, 0.0, 0.0)).pose])
def test_the_outline_is_at_the_border_of_the_image(pose: Pose) -> None:
    outline = footprint(pose, LENS, 0.05)
    points = np.column_stack([outline, np.full(len(outline), 0.05)])
    pixels = LENS.project(np.array([pose.inverse().apply(point) for point in points]))
    across = np.minimum(abs(pixels[:, 0] + 0.5), abs(pixels[:, 0] - 639.5))
    down = np.minimum(abs(pixels[:, 1] + 0.5), abs(pixels[:, 1] - 479.5))
    assert np.minimum(across, down).max() < 1e-6


def test_what_is_above_the_horizon_is_cut_and_what_is_behind_is_not_seen() -> None:
    level = CameraSpec(position=(0.0, 0.0, 0.3), look_at=(1.0, 0.0, 0.3)).pose
    assert np.linalg.norm(footprint(level, LENS, 0.0), axis=1).max() == pytest.approx(FARTHEST)
    assert len(footprint(level, LENS, 0.4)) == 0


def test_the_picture_in_the_docs_is_the_one_that_the_command_writes(tmp_path: Path) -> None:
    main(["--svg", str(tmp_path / "new" / "fields.svg")])
    shown = (ROOT / "docs/images/camera_fields.svg").read_text(encoding="utf-8")
    assert (tmp_path / "new" / "fields.svg").read_text(encoding="utf-8") == shown
