"""Derives the true relations of resting from the poses in the true world."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence

import msgspec
import numpy as np

from agents.scenario.format.geometry import ScenarioBox, overlap
from agents.scenario.format.layout import table_box
from agents.scenario.format.model import Scenario
from agents.scenario.truth.measures import Piece, pose_pieces
from dsr.math3d import polygons
from dsr.math3d.polygons import Polygon, area, hull, intersection
from dsr.math3d.transforms import Pose

HOLLOW = ("container", "cup")
"""Types of objects that others can be in."""
REACH = 0.003
"""m, the largest gap between two things of which one rests on the other"""

_Named = tuple[str, Piece]
_ROUNDING = 1e-6  # of an area
_LEAST_OVERLAP = 0.001  # m, of the outlines seen from above: things side by side do not carry each other


def true_relations(
    scenario: Scenario, truth: dict[str, Pose], held: Collection[str] = ()
) -> frozenset[tuple[str, str]]:
    """Pairs (upper, lower) of which the upper rests on the lower: an object or `table`; nothing that is `held`.

    One rests on the other if lowering it by `REACH` makes it reach into the top of one of the other's pieces, and
    nothing lies between them there that rests on the other one: what is in a bin is not on the table below its floor.
    """
    bodies: dict[str, list[Piece]] = pose_pieces(scenario.objects, truth) | {"table": [table_box(scenario.table)]}
    touching: dict[tuple[str, str], list[tuple[Piece, Piece]]] = {}
    for upper, lower in _near([(name, piece) for name, own in bodies.items() if name not in held for piece in own]):
        if upper[0] != "table" and _rests(upper[1], lower[1]):
            touching.setdefault((upper[0], lower[0]), []).append((upper[1], lower[1]))

    def carried(upper: str, lower: str, pairs: Sequence[tuple[Piece, Piece]]) -> bool:
        between = [name for name in bodies if (upper, name) in touching and (name, lower) in touching]
        pieces = [piece for name in between for piece in bodies[name]]
        return not all(any(_separates(piece, *pair) for piece in pieces) for pair in pairs)

    return frozenset(pair for pair, pieces in touching.items() if carried(*pair, pieces))


def _near(pieces: Sequence[_Named]) -> Iterator[tuple[_Named, _Named]]:
    """Pairs (upper, lower) of pieces of different things of which the upper may rest on the lower.

    Those are left out whose boxes along the axes of the world have no area in common seen from above, or are apart in
    height.
    """
    if not pieces:
        return
    corners = np.array([_outline(piece).corners for _, piece in pieces])
    low, high = corners.min(axis=1), corners.max(axis=1)
    heights = np.array([_heights(piece) for _, piece in pieces])
    apart = (low[:, None, :2] >= high[None, :, :2]).any(axis=2)
    is_over = (heights[:, None, 0] - REACH < heights[None, :, 1]) & (heights[:, None, 1] > heights[None, :, 0])
    for upper, lower in np.argwhere(~(apart | apart.T) & is_over).tolist():
        if pieces[upper][0] != pieces[lower][0]:
            yield pieces[upper], pieces[lower]


def _separates(between: Piece, upper: Piece, lower: Piece) -> bool:
    """Whether `between` carries `upper` wherever that is above `lower`, seen from above."""
    above = [_seen_from_above(piece) for piece in (between, upper, lower)]
    shared, carried = intersection(above[1], above[2]), intersection(above[1], above[0])
    return _rests(upper, between) and area(intersection(shared, carried)) > (1.0 - _ROUNDING) * area(shared)


def _seen_from_above(piece: Piece) -> Polygon:
    return hull((float(x), float(y)) for x, y, _ in _outline(piece).corners)


def true_contents(scenario: Scenario, truth: dict[str, Pose]) -> frozenset[tuple[str, str]]:
    """Pairs (object, container) of which the object's centre is within the bounding box of the container or cup.

    What has the larger bounding box is not in the smaller one: it stands around that.
    """
    there = [spec for spec in scenario.objects if spec.name in truth]
    return frozenset(
        (inner.name, around.name)
        for around in there
        if around.type in HOLLOW
        for inner in there
        if math.prod(inner.size) < math.prod(around.size)
        if np.all(np.abs(truth[around.name].inverse().apply(truth[inner.name].t)) < np.array(around.size) / 2)
    )


def _rests(upper: Piece, lower: Piece) -> bool:
    (bottom, _), (low, high) = _heights(upper), _heights(lower)
    if lower.center[2] >= upper.center[2] or bottom - REACH >= high or bottom < 0.5 * (low + high):
        return False
    lowered = msgspec.structs.replace(upper, center=upper.center - (0.0, 0.0, REACH))
    beside, _ = polygons.overlap(_outline(upper).footprint, _outline(lower).footprint)
    return beside > _LEAST_OVERLAP and overlap(lowered, lower) > 0.0


def _heights(piece: Piece) -> tuple[float, float]:
    """World z of its lowest and highest point, m."""
    if isinstance(piece, ScenarioBox):
        return piece.bottom, piece.top
    return float(piece.center[2]) - piece.radius, float(piece.center[2]) + piece.radius


def _outline(piece: Piece) -> ScenarioBox:
    """A box whose outline seen from above is within that of the piece, and nearly as large."""
    if isinstance(piece, ScenarioBox):
        return piece
    return ScenarioBox(piece.center, np.eye(3), np.full(3, math.sqrt(2.0) * piece.radius))
