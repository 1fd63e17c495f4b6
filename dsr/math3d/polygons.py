"""Convex polygons in the horizontal plane: hulls, common parts, overlaps and gaps.

Counter-clockwise, (x, y) in m. On a handful of points plain floats are several times faster than numpy.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

Point = tuple[float, float]
Polygon = Sequence[Point]

_SAME_POINT = 1e-9  # m


def hull(points: Iterable[Point]) -> Polygon:
    """Convex hull from its least corner on (Andrew's monotone chain, 1979); points closer than 1e-9 m are one."""
    ordered = sorted(points)
    chains = [_half_hull(ordered), _half_hull(ordered[::-1])]
    corners = chains[0][:-1] + chains[1][:-1]
    outline = corners[:1]
    for corner in corners[1:]:
        if min(math.dist(corner, outline[-1]), math.dist(corner, outline[0])) > _SAME_POINT:
            outline.append(corner)
    return outline


def _half_hull(ordered: Sequence[Point]) -> list[Point]:
    chain: list[Point] = []
    for point in ordered:
        while len(chain) > 1 and _cross(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        chain.append(point)
    return chain


def _cross(a: Point, b: Point, c: Point) -> float:
    """Twice the area of the triangle a b c, positive if counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def intersection(a: Polygon, b: Polygon) -> Polygon:
    """The common part of two convex polygons (Sutherland and Hodgman, 1974); empty if there is none."""
    common = list(a)
    for i in range(len(b)):
        common = _clipped(common, b[i - 1], b[i])
    return common


def _clipped(polygon: list[Point], start: Point, end: Point) -> list[Point]:
    """The part of a polygon on the left of the line from `start` to `end`."""
    sides = [_cross(start, end, point) for point in polygon]
    if not sides or min(sides) >= 0.0:
        return polygon
    kept = []
    for i, (point, side) in enumerate(zip(polygon, sides, strict=True)):
        previous, side_before = polygon[i - 1], sides[i - 1]
        if (side >= 0.0) != (side_before >= 0.0):
            s = side_before / (side_before - side)
            kept.append((previous[0] + s * (point[0] - previous[0]), previous[1] + s * (point[1] - previous[1])))
        if side >= 0.0:
            kept.append(point)
    return kept


def area(polygon: Polygon) -> float:
    """Compute the area of a polygon, m^2; positive if its corners (n, 2) are counter-clockwise."""
    return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True))


def contains(polygon: Polygon, point: Point) -> bool:
    """Whether a point is inside a convex polygon or on its edge; never for fewer than three corners."""
    return len(polygon) > 2 and all(_cross(polygon[i - 1], polygon[i], point) >= 0.0 for i in range(len(polygon)))


def normals(polygon: Polygon) -> list[Point]:
    """Unit normals of its edges, outward; the first is that of the edge from the last corner to the first."""
    found = []
    for i, (x, y) in enumerate(polygon):
        ex, ey = x - polygon[i - 1][0], y - polygon[i - 1][1]
        length = math.hypot(ex, ey) or 1.0
        found.append((ey / length, -ex / length))
    return found


def overlap(a: Polygon, b: Polygon) -> tuple[float, Point]:
    """How deep two convex polygons overlap, m, and the unit direction in which `a` leaves `b` soonest.

    Separating axis theorem: the least overlap over the edge normals of both. If they are apart, it is negative, and no
    more than their distance.
    """
    depth, way = math.inf, (0.0, 0.0)
    for normal in (*normals(a), *normals(b)):
        (low_a, high_a), (low_b, high_b) = _extent(a, normal), _extent(b, normal)
        forward, backward = high_b - low_a, high_a - low_b
        if min(forward, backward) < depth:
            sign = 1.0 if forward <= backward else -1.0
            depth, way = min(forward, backward), (sign * normal[0], sign * normal[1])
    return depth, way


def are_apart(a: Polygon, b: Polygon) -> bool:
    """Whether two convex polygons have no area in common: `overlap` is not positive, found sooner."""
    return _is_parting(a, b) or _is_parting(b, a)


def _is_parting(a: Polygon, b: Polygon) -> bool:
    """Whether all of `b` is on the outer side of an edge of `a`."""
    return any(all(_cross(a[i - 1], a[i], point) <= 0.0 for point in b) for i in range(len(a)))


def inclusion(a: Polygon, b: Polygon) -> float:
    """How far (m) a polygon stays within a convex one `b`; negative: how far it sticks out."""
    edges = list(zip(b, normals(b), strict=True))
    return min(nx * (cx - x) + ny * (cy - y) for (cx, cy), (nx, ny) in edges for x, y in a)


def gap(a: Polygon, b: Polygon) -> float:
    """Distance of two convex polygons, m; negative, as deep as they overlap, if they do."""
    depth, _ = overlap(a, b)
    if depth >= 0.0:
        return -depth
    return min(_distance(point, other) for one, other in ((a, b), (b, a)) for point in one)


def _distance(point: Point, polygon: Polygon) -> float:
    """From a point outside a polygon to it."""
    return min(_to_segment(point, polygon[i - 1], polygon[i]) for i in range(len(polygon)))


def _to_segment(point: Point, a: Point, b: Point) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    share = ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / squared if squared else 0.0
    share = min(1.0, max(0.0, share))
    return math.hypot(point[0] - a[0] - share * dx, point[1] - a[1] - share * dy)


def _extent(polygon: Polygon, direction: Point) -> tuple[float, float]:
    along = [direction[0] * x + direction[1] * y for x, y in polygon]
    return min(along), max(along)
