"""Laws of convex polygons."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from dsr.math3d.polygons import Point, Polygon, area, contains, gap, hull, inclusion, intersection, overlap

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


def moved(polygon: Polygon, way: Point, by: float = 1.0) -> Polygon:
    return [(x + by * way[0], y + by * way[1]) for x, y in polygon]


def drawn(seed: int) -> tuple[Polygon, Polygon]:
    rng = np.random.default_rng(seed)
    a, b = (hull(map(tuple, rng.normal(size=(6, 2)).tolist())) for _ in range(2))
    return a, moved(b, tuple(rng.normal(size=2)), 2.0)


@pytest.mark.parametrize("seed", range(40))
def test_polygons_touch_when_moved_by_their_overlap_and_no_sooner(seed: int) -> None:
    a, b = drawn(seed)
    depth, way = overlap(a, b)
    assert (depth > 1e-9) == (abs(area(intersection(a, b))) > 1e-9)
    assert overlap(b, a)[0] == pytest.approx(depth)
    if depth > 0.0:
        assert gap(moved(a, way, depth), b) == pytest.approx(0.0, abs=1e-9)
        for angle in np.linspace(0.0, 2.0 * np.pi, 30):
            assert overlap(moved(a, (np.cos(angle), np.sin(angle)), 0.99 * depth), b)[0] > 0.0


@pytest.mark.parametrize("seed", range(40))
def test_a_gap_is_the_least_distance_of_points(seed: int) -> None:
    a, b = drawn(seed)
    depth, _ = overlap(a, b)
    if depth > 0.0:
        assert gap(a, b) == -depth
        return
    shares = np.linspace(0.0, 1.0, 200)[:, None]
    outlines = [np.concatenate([shares * p[i - 1] + (1.0 - shares) * p[i] for i in range(len(p))])
                for p in (np.array(a), np.array(b))]  # fmt: skip
    least = np.linalg.norm(outlines[0][:, None] - outlines[1], axis=2).min()
    assert gap(a, b) == pytest.approx(least, abs=0.01)
    assert gap(a, b) >= -depth - 1e-12


def test_how_far_a_polygon_stays_within_another() -> None:
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert inclusion([(0.2, 0.5), (0.3, 0.4), (0.6, 0.9)], square) == pytest.approx(0.1)
    assert inclusion([(0.2, 0.5), (1.3, 0.4)], square) == pytest.approx(-0.3)
