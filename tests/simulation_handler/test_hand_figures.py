"""The room that a hand takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose
from simulation_handler.hands.anatomy import ADULT, anatomy_of
from simulation_handler.hands.figures import hand_solid
from simulation_handler.shapes.geometry import Solid

ELSEWHERE = Pose.from_rotvec((0.3, -0.1, 0.2), (0.2, 0.6, 1.0))


def covers(hand: Solid, point: tuple[float, float, float]) -> bool:
    return any(part.reaches_around(point) for part in hand.parts)


@pytest.mark.parametrize("palm", [Pose.identity(), ELSEWHERE])
def test_a_finger_is_where_its_tip_was_measured_or_where_it_would_be_at_rest(palm: Pose) -> None:
    bent = (palm @ Pose((0.09, 0.03, -0.06))).t
    relaxed = (palm @ Pose((0.105, 0.04, -0.009))).t
    assert covers(hand_solid("hand", palm, {}), relaxed)
    assert not covers(hand_solid("hand", palm, {}), bent)
    assert covers(hand_solid("hand", palm, {1: bent}), bent)
    assert not covers(hand_solid("hand", palm, {1: bent}), relaxed)


def test_the_thumb_of_a_left_hand_is_on_the_other_side() -> None:
    right, left = (hand_solid("hand", Pose.identity(), {}, is_left=is_left) for is_left in (False, True))
    thumb = (0.04, 0.07, -0.02)
    assert covers(right, thumb)
    assert not covers(left, thumb)
    assert covers(left, (0.04, -0.07, -0.02))


def test_what_is_too_far_for_a_fingertip_is_none() -> None:
    hand = hand_solid("hand", Pose.identity(), {1: (0.5, 0.0, 0.0)})
    assert not covers(hand, (0.3, 0.0, 0.0))
    assert covers(hand, (-0.15, 0.0, 0.0)), "the forearm"


def test_the_box_around_a_hand_holds_its_fingertips_and_its_forearm() -> None:
    hand = hand_solid("hand", Pose.identity(), {})
    for point in ((0.113, 0.006, -0.01), (0.044, 0.072, -0.02), (-0.345, 0.055, -0.08)):
        assert all(abs(p - q) < 0.5 * side for p, q, side in zip(point, hand.position, hand.size, strict=True))


def test_a_wrong_size_in_a_model_of_a_hand_is_told_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "hand.toml"
    file.write_text(ADULT.read_text().replace("tip_radius = 0.008", "tip_radius = -0.008"))
    with pytest.raises(ConfigError, match=r"hand\.toml.*:5.*tip_radius"):
        anatomy_of(file)
