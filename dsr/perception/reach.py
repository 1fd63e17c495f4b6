"""How far from the world's origin anything of the belief may be, whoever says where it is."""

from __future__ import annotations

import math

from dsr.errors import SchemaError
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose

FARTHEST = 100.0
"""m from the world's origin that anything may be: farther is an error, not a tabletop"""


def near(node: Node, pose: Pose) -> Pose:
    """A pose that is told of a node. Raises `SchemaError` for one that no tabletop reaches."""
    if math.hypot(*pose.t) > FARTHEST:
        raise SchemaError(f"{node}: {math.hypot(*pose.t):.3g} m from the world's origin; at most {FARTHEST}")
    return pose
