"""Collision shapes of convex pieces given by their corners.

pybullet takes a file of several objects as that many convex hulls, however many, and makes each thicker by a margin of
1 mm all around: so the pieces are made smaller by that first.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pybullet
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.shapes import Part, Shape
from dsr.perception.scales import RESOLUTION

_LEAST_EXTENT = 0.1  # of its extent that a thin piece keeps at least


def make_hulls(shape: Shape, client: int) -> int:
    """The physics client's number of a shape of convex pieces, negative if refused; those without corners are boxes."""
    with tempfile.TemporaryDirectory(prefix="dsr-hulls-") as folder:
        file = Path(folder) / "hulls.obj"  # another folder each time: pybullet remembers files by name
        file.write_text(_as_obj([_corners(part) for part in shape]), encoding="ascii")
        made: int = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(file), physicsClientId=client)
    return made


def _corners(part: Part) -> NDArray[np.float64]:
    """(n, 3) m in the body's frame, without the margin that pybullet adds."""
    half = 0.5 * np.array(part.size)
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    own = np.array(part.corners) if part.corners else signs * half
    turn = np.array(quaternions.to_matrix(part.rotation))
    smaller = np.maximum(1.0 - RESOLUTION / half, _LEAST_EXTENT)
    return np.asarray((own * smaller) @ turn.T + part.position)


def _as_obj(hulls: list[NDArray[np.float64]]) -> str:
    from scipy.spatial import ConvexHull  # takes 0.4 s, for which scenes without meshes need not wait

    lines: list[str] = []
    first = 1
    for number, hull in enumerate(hulls):
        lines.append(f"o hull_{number}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in hull.tolist()]
        lines += [f"f {a + first} {b + first} {c + first}" for a, b, c in ConvexHull(hull).simplices.tolist()]
        first += len(hull)
    return "\n".join([*lines, ""])
