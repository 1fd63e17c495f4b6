"""What must be beneath a hovering object."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.math3d.quaternions import Vector3
from simulation_handler.contact.supports import UNKNOWN, Beneath, find_beneath
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE

TABLE = Solid("table", (1.2, 1.2, 0.04), (0.35, 0.0, -0.02), fixed=True)
COVARIANCE = np.diag([1e-6, 1e-6, 1e-4])


def hovering(bottom: float) -> Solid:
    return Solid("top", CUBE, (0.4, 0.1, bottom + 0.02))


def found(above: Solid, unseen: dict[str, Vector3], others: list[Solid]) -> Beneath | None:
    """With a height that is known to 10 mm."""
    return find_beneath(above, COVARIANCE, unseen, others, sigmas=1.7)


@pytest.mark.parametrize(("bottom", "names"), [(0.052, ["a"]), (0.088, ["a", "b"]), (0.12, ["a", "b", "c"])])
def test_objects_that_were_never_seen_are_stacked_beneath(bottom: float, names: list[str]) -> None:
    beneath = found(hovering(bottom), dict.fromkeys("abc", CUBE), [TABLE])
    assert beneath is not None and beneath.prop is None
    assert [solid.name for solid in beneath.stack] == names
    for level, solid in enumerate(beneath.stack):
        assert solid.position == pytest.approx((0.4, 0.1, 0.02 + 0.04 * level))


def test_the_stack_is_where_the_viewing_ray_meets_its_height() -> None:
    ray = np.array([0.6, 0.0, -0.8])
    beneath = find_beneath(hovering(0.052), 1e-4 * np.outer(ray, ray) + 1e-12 * np.eye(3), {"a": CUBE}, [TABLE], 1.7)
    assert beneath is not None
    assert beneath.stack[0].position == pytest.approx((0.4 + 0.012 * 0.75, 0.1, 0.02), abs=1e-5)


def test_the_best_fitting_height_is_taken() -> None:
    sizes = {"a": (0.04, 0.04, 0.05), "b": (0.04, 0.04, 0.03), "c": CUBE}
    beneath = found(hovering(0.031), sizes, [TABLE])
    assert beneath is not None
    assert [solid.name for solid in beneath.stack] == ["b"]


def test_otherwise_an_unknown_stack_of_its_like_is_assumed() -> None:
    beneath = found(hovering(0.09), {}, [TABLE])
    assert beneath is not None and beneath.stack == ()
    assert beneath.prop is not None
    assert beneath.prop.name == UNKNOWN
    assert beneath.prop.top == pytest.approx(0.08)


def test_the_gap_is_counted_from_what_is_below() -> None:
    below = Solid("below", CUBE, (0.4, 0.1, 0.02))
    beneath = found(hovering(0.085), {"a": CUBE}, [TABLE, below])
    assert beneath is not None
    assert beneath.stack[0].bottom == pytest.approx(0.04)


@pytest.mark.parametrize("bottom", [0.02, 0.06, 0.4])
def test_a_height_that_nothing_explains(bottom: float) -> None:
    assert found(hovering(bottom), {}, [TABLE]) is None
    assert found(hovering(0.05), {}, []) is None
