"""The reading of the palm detector, and the squares in which landmarks are looked for."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from agents.hand_tracker.model.palms import ANCHORS, PIXELS, VALUES, anchors, read_palms
from agents.hand_tracker.model.regions import Region, about_hand, about_palm, cut_out, overlap, whole_image

SURE, NEVER = 8.0, -8.0
"""Logits"""


def answers(*palms: tuple[int, tuple[float, float], float]) -> tuple[np.ndarray, np.ndarray]:
    """The detector's, with palms at an anchor, moved by (x, y) px, of a logit; all 48 px wide, fingers up."""
    values, logits = np.zeros((ANCHORS, VALUES), np.float32), np.full(ANCHORS, NEVER, np.float32)
    for anchor, (x, y), logit in palms:
        values[anchor, :4] = x, y, 48.0, 48.0
        values[anchor, 4:].reshape(7, 2)[:] = x, y
        values[anchor, 4:].reshape(7, 2)[[0, 2]] += ((0.0, 20.0), (0.0, -20.0))
        logits[anchor] = logit
    return values, logits


def test_anchors_are_the_cells_of_two_grids() -> None:
    assert anchors().shape == (ANCHORS, 2)
    assert anchors()[0] == pytest.approx((0.5 / 24, 0.5 / 24)) and anchors()[2] == pytest.approx((1.5 / 24, 0.5 / 24))
    assert anchors()[1152] == pytest.approx((0.5 / 12, 0.5 / 12)) and anchors()[-1] == pytest.approx((11.5 / 12,) * 2)


def test_answers_that_overlap_are_one_palm_in_their_weighted_middle() -> None:
    values, logits = answers((600, (0.0, 0.0), SURE), (601, (8.0, 0.0), SURE), (10, (0.0, 0.0), 1.0))
    first, second = read_palms(values, logits, 0.5)
    assert (first.box[:2] + first.box[2:]) / 2 == pytest.approx(anchors()[600] + (4.0 / PIXELS, 0.0))
    assert first.middle[1] < first.wrist[1] and first.score > second.score
    assert read_palms(values, logits, 0.9999) == []


def test_what_is_no_number_is_no_palm() -> None:
    values, logits = answers((600, (0.0, 0.0), SURE), (10, (0.0, 0.0), SURE))
    values[600, 7] = np.nan
    (palm,) = read_palms(values, logits, 0.5)
    assert (palm.box[:2] + palm.box[2:]) / 2 == pytest.approx(anchors()[10])


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.5])
def test_the_square_about_a_palm_is_turned_to_the_fingers_and_moved_there(turn: float) -> None:
    up = np.array([math.sin(turn), -math.cos(turn)])
    middle = np.array([100.0, 80.0])
    region = about_palm(np.array([80.0, 60.0, 120.0, 100.0]), middle - 15 * up, middle + 15 * up)
    assert region.turn == pytest.approx(turn) and region.side == pytest.approx(2.6 * 40)
    assert region.centre == pytest.approx(tuple(middle + 20 * up))
    assert region.in_image(np.array([[0.5, 0.0]]))[0] == pytest.approx(np.array(region.centre) + region.side / 2 * up)


def test_a_square_is_cut_out_as_it_lies() -> None:
    color = np.zeros((120, 160, 3), np.uint8)
    region = Region((80.0, 60.0), 60.0, 0.9)
    (x, y), (u, v) = region.in_image(np.array([[0.25, 0.5], [0.75, 0.25]]))
    cv2.circle(color, (round(x), round(y)), 4, (255, 0, 0), -1)
    cv2.circle(color, (round(u), round(v)), 4, (0, 255, 0), -1)
    (picture,) = cut_out(color, region, 96, cv2.BORDER_CONSTANT)
    assert picture.dtype == np.float32 and picture[48, 24] == pytest.approx((1.0, 0.0, 0.0))
    assert picture[24, 72] == pytest.approx((0.0, 1.0, 0.0)) and picture[90, 90].max() == 0.0


def test_the_square_about_landmarks_follows_the_hand() -> None:
    hand = np.zeros((21, 2))
    hand[:, 1] = -np.arange(21.0)
    hand[[5, 9, 13, 17], 0] = -15.0, -5.0, 5.0, 15.0
    hand[[5, 9, 13, 17], 1] = -40.0
    turned = hand @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + (200.0, 100.0)
    upright, aside = about_hand(hand), about_hand(turned)
    assert aside.side == pytest.approx(upright.side) and aside.turn - upright.turn == pytest.approx(math.pi / 2)
    assert np.array(aside.centre) == pytest.approx(
        np.array([[0.0, -1.0], [1.0, 0.0]]) @ upright.centre + (200.0, 100.0)
    )


def test_overlap_is_intersection_over_union() -> None:
    square = Region((0.0, 0.0), 2.0, 0.0)
    assert overlap(square, square) == pytest.approx(1.0)
    assert overlap(square, Region((1.0, 0.0), 2.0, 0.3)) == pytest.approx(1 / 3)
    assert overlap(square, Region((5.0, 0.0), 2.0, 0.0)) == 0.0
    assert overlap(square, Region((0.0, 0.0), 1.0, 0.0)) == pytest.approx(0.25)


def test_the_whole_image_fits_into_its_square() -> None:
    region = whole_image(np.zeros((48, 64, 3), np.uint8))
    assert region == Region((32.0, 24.0), 64.0, 0.0)
