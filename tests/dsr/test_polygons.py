"""Laws of convex polygons."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, example, given
from hypothesis import strategies as st

from dsr.math3d.polygons import area, contains, hull

COORDINATE = st.floats(-1.0, 1.0)


@given(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=3, max_size=12))
@example([(0.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (-1.0, 2.8e-36)])
def test_a_hull_is_convex_and_holds_its_points(points: list[tuple[float, float]]) -> None:
    outline = hull(points)
    assume(len(outline) > 2 and area(outline) > 1e-6)
    assert hull(outline) == outline
    centre = np.mean(outline, axis=0)
    grown = [tuple(centre + (np.array(p) - centre) * (1 + 1e-6)) for p in outline]
    assert all(contains(grown, point) for point in points)
