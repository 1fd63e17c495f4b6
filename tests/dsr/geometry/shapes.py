"""Meshes that the tests share."""

from __future__ import annotations

import numpy as np

from dsr.geometry import Mesh

CORNERS = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
FACES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


def block(x: float = 1.0, y: float = 1.0, z: float = 1.0) -> Mesh:
    """A solid block with one corner in the origin."""
    return Mesh(np.array(CORNERS) * (x, y, z), np.array(FACES))


def cloud(vertices: int, seed: int = 0) -> Mesh:
    """Triangles between random points."""
    random = np.random.default_rng(seed)
    return Mesh(random.normal(size=(vertices, 3)), random.integers(0, vertices, (2 * vertices, 3)))
