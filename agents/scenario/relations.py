"""What rests on what in the true world, from where everything is."""

from __future__ import annotations

import math
from itertools import permutations

import msgspec
import numpy as np

from agents.scenario.geometry import Box, footprint_overlap, overlap
from agents.scenario.layout import table_box
from agents.scenario.measures import Piece, pose_pieces
from agents.scenario.model import Scenario
from dsr.transforms import Pose

GROUND = ("table",)
"""What else things rest on, as a node of the working memory; the floor has none."""
HOLLOW = ("container", "cup")
"""Types of objects that others can be in."""
REACH = 0.003
"""m, the largest gap between two things of which one rests on the other"""

_LEAST_OVERLAP = 0.001  # m, of the outlines seen from above: things side by side do not carry each other


def true_relations(scenario: Scenario, truth: dict[str, Pose], held: str | None = None) -> frozenset[tuple[str, str]]:
    """Pairs (upper, lower) of which the upper rests on the lower: an object or `table`; nothing that is `held`.

    One rests on the other if lowering it by `REACH` makes it reach into the top of one of the other's pieces.
    """
    bodies: dict[str, list[Piece]] = pose_pieces(scenario, truth) | {"table": [table_box(scenario.table)]}
    return frozenset(
        (upper, lower)
        for upper, lower in permutations(bodies, 2)
        if upper != "table" and held not in (upper, lower)
        if any(_rests(piece, below) for piece in bodies[upper] for below in bodies[lower])
    )


def true_contents(scenario: Scenario, truth: dict[str, Pose]) -> frozenset[tuple[str, str]]:
    """Pairs (object, container) of which the object's centre is within the bounding box of the container or cup."""
    hollow = [spec for spec in scenario.objects if spec.type in HOLLOW and spec.name in truth]
    return frozenset(
        (name, spec.name)
        for spec in hollow
        for name, pose in truth.items()
        if name != spec.name and np.all(np.abs(truth[spec.name].inverse().apply(pose.t)) < np.array(spec.size) / 2)
    )


def _rests(upper: Piece, lower: Piece) -> bool:
    (bottom, _), (low, high) = _heights(upper), _heights(lower)
    if lower.center[2] >= upper.center[2] or bottom - REACH >= high or bottom < 0.5 * (low + high):
        return False
    lowered = msgspec.structs.replace(upper, center=upper.center - (0.0, 0.0, REACH))
    beside = footprint_overlap(_outline(upper), _outline(lower))
    return beside > _LEAST_OVERLAP and overlap(lowered, lower) > 0.0


def _heights(piece: Piece) -> tuple[float, float]:
    """World z of its lowest and highest point, m."""
    if isinstance(piece, Box):
        return piece.bottom, piece.top
    return float(piece.center[2]) - piece.radius, float(piece.center[2]) + piece.radius


def _outline(piece: Piece) -> Box:
    """A box whose outline seen from above is within that of the piece, and nearly as large."""
    if isinstance(piece, Box):
        return piece
    return Box(piece.center, np.eye(3), np.full(3, math.sqrt(2.0) * piece.radius))
