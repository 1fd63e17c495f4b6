"""Intrinsics that somebody states for a camera: of a calibration, or from its field of view."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from agents.cameras.given_intrinsics import GivenIntrinsics, SizeError
from agents.intrinsics_file import read_intrinsics_file
from dsr.errors import ConfigError
from dsr.vocabulary.intrinsics import Intrinsics

TOML = """fx = 500.5
fy = 501.5
cx = 320.25
cy = 240.75
width = 640
height = 480
"""


def test_a_stated_field_of_view_is_for_pictures_of_any_size() -> None:
    meta = GivenIntrinsics(fov=90.0).meta((480, 640, 3))
    assert meta["fx"] == pytest.approx(320.0) and meta["cx"] == 319.5
    assert meta == Intrinsics.from_fov(640, 480, math.pi / 2).meta()
    assert GivenIntrinsics().meta((480, 640, 3)) == {}


def test_a_calibration_is_for_pictures_of_its_size_only(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text(TOML)
    given = GivenIntrinsics(str(tmp_path / "camera.toml"))
    assert given.meta((480, 640, 3)) == read_intrinsics_file(tmp_path / "camera.toml").meta()
    with pytest.raises(SizeError, match="1280 x 720 px, and its calibration is about 640 x 480"):
        given.meta((720, 1280, 3))


def test_options_that_make_no_sense() -> None:
    for fov in (-1.0, 180.0, math.nan):
        with pytest.raises(ConfigError, match="fov"):
            GivenIntrinsics(fov=fov)
    with pytest.raises(ConfigError, match="not both"):
        GivenIntrinsics("a.toml", 60.0)
    with pytest.raises(ConfigError, match="No such file"):
        GivenIntrinsics("a.toml")
