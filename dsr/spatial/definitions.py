"""Spatial relations between boxes, by how far they hold; pure.

The relations are those of Underworlds (S. Lemaignan et al., IROS 2018, Sec. III-C) and of its client
`spatial_relations`, from world bounding boxes there, from oriented boxes here. Each function gives a *margin* in
metres: 0 or more if the relation holds, and how far it is from changing. `EPSILON` is that of the physics reasoner
(Y. Sallami et al.).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from dsr.math3d.quaternions import Vector3, to_matrix
from dsr.math3d.transforms import Pose
from dsr.spatial.boxes import Box, gap, inclusion, overlap

EPSILON = 0.015
"""m, by which boxes may reach into each other, or be apart, where they touch."""
_CLOSE = 2.0  # diagonals
_STEEP = math.cos(math.radians(15.0))  # a line of sight nearer to the vertical has no direction on the ground


class View(NamedTuple):
    """From where somebody looks; horizontal unit vectors in the world."""

    away: Vector3
    """Unit vector from the viewer into the scene."""
    left: Vector3
    """Unit vector to the viewer's left."""

    @staticmethod
    def of(pose: Pose, *, optical: bool) -> View:
        """The view of a frame.

        Args:
            pose: world_from_frame.
            optical: the frame is that of a camera (z forward, x right, y down), else of a body (x forward, z up).

        Who looks straight down or up has no direction on the ground; then it is that of the upper edge of the image.
        """
        x_axis, y_axis, z_axis = zip(*to_matrix(pose.q), strict=True)
        x, y, z = z_axis if optical else x_axis
        if abs(z) > _STEEP:
            sign = (-1.0 if optical else 1.0) * (1.0 if z < 0.0 else -1.0)
            x, y, _ = (sign * part for part in (y_axis if optical else z_axis))
        length = math.hypot(x, y)
        x, y = x / length, y / length
        return View((x, y, 0.0), (-y, x, 0.0))


def above(a: Box, b: Box) -> float:
    """Margin (m), 0 or more if the bottom of `a` is not below the top of `b`, and their footprints overlap.

    Underworlds `isabove`.
    """
    return min(a.bottom - b.top + EPSILON, overlap(a, b))


def below(a: Box, b: Box) -> float:
    """Margin (m), 0 or more if `b` is above `a`.

    (Underworlds' `isbelow` has no tolerance and so is not the inverse of `isabove`.)
    """
    return above(b, a)


def on_top(a: Box, b: Box) -> float:
    """Margin (m), 0 or more if `a` is above `b` and close to its top (Underworlds `isontop`, Sallami's isOnTop)."""
    return min(above(a, b), EPSILON - (a.bottom - b.top))


def in_(a: Box, b: Box) -> float:
    """Margin (m), 0 or more if `a` is in `b`: its footprint within that of `b`, its bottom between bottom and top.

    Underworlds `isin`, Sallami's isIn.

    Deeper than `EPSILON` below the top, unlike there, where what stands on a larger box also is in it.
    """
    return min(inclusion(a, b) + EPSILON, a.bottom - b.bottom + EPSILON, b.top - EPSILON - a.bottom)


def close_to(a: Box, b: Box) -> float:
    """Margin (m), 0 or more if the centre of `a` is within two diagonals of `b` of the centre of `b`.

    Underworlds `isclose`. Not symmetric.
    """
    return _CLOSE * b.diagonal - math.dist(a.pose.t, b.pose.t)


def next_to(a: Box, b: Box) -> float:
    """Margin (m), 0 or more if `a` and `b` are side by side.

    They are at the same height, their footprints apart, with no room between them for the narrower one.

    Named by SPARK (E. A. Sisbot et al., RO-MAN 2011) as isNextTo; this definition is our own. Symmetric.
    """
    beside = gap(a, b)
    level = min(a.top - b.bottom, b.top - a.bottom)
    return min(level - EPSILON, beside + EPSILON, min(a.width, b.width) - beside)


def in_front_of(a: Box, b: Box, view: View) -> float:
    """Margin (m), 0 or more if `a` is nearer to the viewer: all of it before all of `b`, along the view on the ground.

    Underworlds' `issouth` with the viewer's axes for the world's, and `EPSILON` for things that touch.
    """
    return _precedes(a, b, view.away)


def behind(a: Box, b: Box, view: View) -> float:
    """Margin (m), 0 or more if `b` is in front of `a` (Underworlds `isnorth`)."""
    return _precedes(b, a, view.away)


def left_of(a: Box, b: Box, view: View) -> float:
    """Margin (m), 0 or more if all of `a` is left of all of `b` as the viewer sees it (Underworlds `iswest`)."""
    return _precedes(b, a, view.left)


def right_of(a: Box, b: Box, view: View) -> float:
    """Margin (m), 0 or more if `b` is left of `a` (Underworlds `iseast`)."""
    return _precedes(a, b, view.left)


def _precedes(a: Box, b: Box, direction: Vector3) -> float:
    """Also by their centres: of two thin things that touch, one only is before the other."""
    (low_a, high_a), (low_b, high_b) = a.extent(direction), b.extent(direction)
    return min(low_b - high_a + EPSILON, 0.5 * (low_b + high_b - low_a - high_a))


ALLOCENTRIC: dict[str, Callable[[Box, Box], float]] = {
    "above": above, "below": below, "next_to": next_to, "close_to": close_to, "on_top": on_top, "in": in_,
}  # fmt: skip
"""Relations that are the same for everybody, by name."""
EGOCENTRIC: dict[str, Callable[[Box, Box, View], float]] = {
    "in_front_of": in_front_of, "behind": behind, "left_of": left_of, "right_of": right_of,
}  # fmt: skip
"""Relations as somebody sees them, by name."""
SPATIAL = (*ALLOCENTRIC, *EGOCENTRIC)
"""Names of all spatial relations."""
MIRRORED = {
    "above": "below", "below": "above", "next_to": "next_to", "in_front_of": "behind", "behind": "in_front_of",
    "left_of": "right_of", "right_of": "left_of",
}  # fmt: skip
"""The relation that holds of (b, a) if the key holds of (a, b)."""


def margin(relation: str, a: Box, b: Box, view: View | None = None) -> float:
    """Measure how far (m) `a` is in the relation to `b`; negative if it is not.

    Raises:
        KeyError: for an unknown relation.
        ValueError: for an egocentric one without a view.
    """
    if relation in ALLOCENTRIC:
        return ALLOCENTRIC[relation](a, b)
    if view is None:
        raise ValueError(f"{relation} depends on who looks: it needs a view")
    return EGOCENTRIC[relation](a, b, view)
