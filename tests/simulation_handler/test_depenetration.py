"""Bodies that reach into each other are brought apart in a given direction, and no further than they must."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.math3d import quaternions
from simulation_handler.contact.depenetration import depenetrated
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE

UP = np.array((0.0, 0.0, 1.0))
LOWER = Solid("lower", CUBE, (0.0, 0.0, 0.02))


def cube(x: float, z: float, tilt: float = 0.0) -> Solid:
    return Solid("upper", CUBE, (x, 0.0, z), quaternions.from_rotvec((0.0, tilt, 0.0)))


def test_what_is_clear_stays() -> None:
    for solid in (cube(0.0, 0.0601), cube(0.041, 0.02), cube(0.0, -0.03)):
        assert depenetrated(solid, [LOWER], UP) is solid


@pytest.mark.parametrize("x", [0.0, 0.03, -0.039])
def test_an_upright_cube_goes_up_to_the_top_of_the_lower_one(x: float) -> None:
    assert depenetrated(cube(x, 0.055), [LOWER], UP).position == pytest.approx((x, 0.0, 0.06), abs=1e-4)


def test_a_tilted_cube_is_not_held_up_by_the_corner_that_is_beside_the_lower_one() -> None:
    """Its lowest corner is below the top of the lower cube, but beyond the edge."""
    tilt, x = 0.3, 0.028
    solid = depenetrated(cube(x, 0.055, tilt), [LOWER], UP)
    touching = 0.04 + (0.02 - (x - 0.02) * np.sin(tilt)) / np.cos(tilt)  # its underside on the edge at (0.02, 0.04)
    assert solid.position == pytest.approx((x, 0.0, touching), abs=1e-4)
    assert solid.bottom < LOWER.top - 0.001


def test_it_goes_along_the_direction_given() -> None:
    aslant = np.array((0.6, 0.0, 0.8))
    x, _, z = depenetrated(cube(0.0, 0.05), [LOWER], aslant).position
    assert (x, z) == pytest.approx((0.0075, 0.06), abs=1e-4)


def test_the_way_out_of_one_does_not_end_in_another() -> None:
    above = Solid("above", CUBE, (0.01, 0.0, 0.075))
    assert depenetrated(cube(0.0, 0.03), [LOWER, above], UP).position[2] == pytest.approx(0.115, abs=2e-4)
