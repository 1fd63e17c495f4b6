"""`dsr what-if`: how a place is written."""

from __future__ import annotations

import pytest

from dsr.cli.what_if import parsed_placing
from dsr.errors import ConfigError


@pytest.mark.parametrize("text", ["cube_3", "=1,2,3", "cube_3=0.3,0.1", "cube_3=0.3,x,0.1", "cube_3=1,2,3,4,5"])
def test_what_is_no_place_says_how_one_is_written(text: str) -> None:
    with pytest.raises(ConfigError, match="expected NAME=X,Y,Z in m"):
        parsed_placing(text)


@pytest.mark.parametrize(("text", "why"), [("a=nan,0,0", "finite"), ("a=0,0,0,0,0,0,0", "norm 0")])
def test_numbers_that_are_no_pose_are_told(text: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        parsed_placing(text)


def test_a_yaw_and_a_quaternion_are_read() -> None:
    assert parsed_placing("a=1,2,3,0").pose == parsed_placing("a=1,2,3,0,0,0,1").pose
