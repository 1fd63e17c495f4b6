"""How many objects that seem displaced alike tell of a moved camera, by what each of them shows."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.perception.consensus import agree_beyond_chance, tells_rotation


@pytest.mark.parametrize(
    ("turnings", "is_enough"),
    [
        ([], False), ([True], False), ([False, False], False), ([True, False], True), ([True, True], True),
        ([False, False, False], True),
    ],
)  # fmt: skip
def test_a_place_or_turn_more_than_those_of_a_pose_must_agree(turnings: list[bool], is_enough: bool) -> None:
    assert agree_beyond_chance(turnings) is is_enough


def test_a_rotation_is_told_up_to_half_a_radian_about_each_axis() -> None:
    assert tells_rotation(np.diag([0.2, 0.2, 0.2]))
    assert not tells_rotation(np.diag([0.01, 0.01, np.pi**2])), "a can shows how it leans, but not its yaw"
