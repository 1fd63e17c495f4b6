"""Tells where a thing lies that nothing holds any more: on what is beneath it, and nowhere in the air."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dsr.math3d.transforms import Pose
from simulation_handler.contact.placement import find_support
from simulation_handler.contact.relations import SupportedPose
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import FLOOR


def let_go(solid: Solid, others: Sequence[Solid]) -> SupportedPose | None:
    """Where a solid lies once nothing holds it any more: on the highest thing beneath; None if there is none."""
    flat, _ = solid.face_down()
    beneath = [other for other in others if other.top < flat.position[2]]
    supports, level = find_support(flat, flat.bottom, beneath, math.inf)
    if level is None:
        return None
    x, y, _ = flat.position
    place = Pose.unchecked((x, y, level + flat.half_height), flat.rotation)
    return SupportedPose(place, tuple(name for name in supports if name != FLOOR))
