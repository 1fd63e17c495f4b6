"""What the close-up shows: all objects that rest on a table, as near as they allow."""

from __future__ import annotations

import math

import pytest

from agents.viewer.framing import ANYWHERE, Framing
from agents.viewer.model import DrawnPlace, DrawnSolid

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
TABLE = DrawnSolid("table", "table", DrawnPlace((0.3, 0.0, 0.0), UPRIGHT), (1.0, 0.8, 0.04))


def cube(x: float, y: float, z: float = 0.02, type: str = "cube", held: bool = False) -> DrawnSolid:
    return DrawnSolid("thing", type, DrawnPlace((x, y, z), UPRIGHT), (0.04, 0.04, 0.04), True, held)


def test_without_objects_it_looks_where_an_arm_works() -> None:
    framing = Framing()
    framing.note([], [TABLE])
    assert framing.focus == ANYWHERE


def test_it_looks_at_the_middle_of_the_objects() -> None:
    framing = Framing()
    framing.note([cube(0.2, -0.3), cube(0.5, 0.3)], [TABLE])
    x, y, z = framing.focus.at
    assert x == pytest.approx(0.35, abs=0.06) and y == pytest.approx(0.0, abs=0.06) and z == ANYWHERE.at[2]
    assert framing.focus.distance > 1.5 * math.dist((0.2, -0.3), (0.5, 0.3)) / 2


def test_a_single_object_is_not_looked_at_from_too_near() -> None:
    framing = Framing()
    framing.note([cube(0.3, 0.1)], [TABLE])
    assert framing.focus.distance == ANYWHERE.distance


def test_it_stands_still_while_things_move_a_little_and_never_comes_nearer() -> None:
    framing = Framing()
    framing.note([cube(0.22, 0.0), cube(0.47, 0.0)], [TABLE])
    before = framing.focus
    framing.note([cube(0.23, 0.01), cube(0.46, 0.0)], [TABLE])
    framing.note([cube(0.3, 0.0)], [TABLE])
    assert framing.focus == before
    framing.note([cube(0.7, 0.0)], [TABLE])
    assert framing.focus.distance > before.distance


@pytest.mark.parametrize(
    "other", [cube(0.3, 0.0, -0.7), cube(3.0, 0.0), cube(0.3, 0.3, held=True), cube(0.3, 0.3, type="hand")]
)
def test_what_fell_or_is_held_or_is_a_hand_is_not_waited_for(other: DrawnSolid) -> None:
    framing = Framing()
    framing.note([other], [TABLE])
    assert framing.focus == ANYWHERE


def test_without_a_table_every_object_counts() -> None:
    framing = Framing()
    framing.note([cube(3.0, 2.0)], [])
    assert framing.focus.at[:2] == pytest.approx((3.0, 2.0), abs=0.06)
