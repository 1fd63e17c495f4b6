"""isIn and isOnTop from bounding boxes."""

from __future__ import annotations

import math

import pytest

from benchmarks.baselines.physics_reasoner.boxes import BoxRelations, WorldBox, is_in, is_on_top, world_box
from dsr.math3d.transforms import Pose

CUBE = (0.04, 0.04, 0.04)
BOX = (0.2, 0.2, 0.1)
AT_ORIGIN = world_box(BOX, Pose((0.0, 0.0, 0.05)))
TABLE = WorldBox((-1.0, -1.0, -0.04), (1.0, 1.0, 0.0))


def cube(x: float, z: float) -> WorldBox:
    return world_box(CUBE, Pose((x, 0.0, z)))


def test_a_turned_box_needs_more_room():
    turned = world_box((0.2, 0.1, 0.3), Pose.from_rotvec((1.0, 2.0, 3.0), (0.0, 0.0, math.pi / 2)))
    assert turned.low == pytest.approx((0.95, 1.9, 2.85)) and turned.high == pytest.approx((1.05, 2.1, 3.15))


@pytest.mark.parametrize(
    ("x", "z", "expected"),
    [
        (0.0, 0.023, True),
        (0.07, 0.023, True),
        (0.09, 0.023, False),
        (0.0, 0.12, False),
        (0.0, 0.1, True),
        (0.3, 0.02, False),
    ],
)
def test_in_is_what_stands_between_bottom_and_top(x: float, z: float, expected: bool):
    assert is_in(cube(x, z), AT_ORIGIN) is expected


@pytest.mark.parametrize(
    ("x", "z", "expected"),
    [(0.0, 0.12, True), (0.0, 0.13, True), (0.0, 0.14, False), (0.0, 0.1, False), (0.13, 0.12, False)],
)
def test_on_top_is_what_stands_at_the_top(x: float, z: float, expected: bool):
    assert is_on_top(cube(x, z), AT_ORIGIN) is expected


def test_relations_do_not_flicker_at_their_bounds_and_keep_their_beginning():
    relations = BoxRelations()
    for step, x in enumerate((0.079, 0.081, 0.079, 0.094, 0.081)):
        relations.update({"ball": cube(x, 0.023), "box": AT_ORIGIN}, {"table": TABLE}, float(step))
        assert relations.inside == {("ball", "box"): 0.0}
    assert relations.on_top == {("ball", "table"): 0.0, ("box", "table"): 0.0}
    relations.update({"ball": cube(0.096, 0.023), "box": AT_ORIGIN}, {}, 9.0)
    assert relations.inside == {}
    relations.update({"ball": cube(0.081, 0.023), "box": AT_ORIGIN}, {}, 10.0)
    assert relations.inside == {}, "it begins further inside than it ended"


def test_contents_are_told_and_forgotten():
    relations = BoxRelations()
    relations.update({"ball": cube(0.0, 0.023), "box": AT_ORIGIN}, {}, 0.0)
    assert relations.contents("box") == ("ball",) and relations.contents("ball") == ()
    relations.forget("ball")
    assert relations.contents("box") == ()
