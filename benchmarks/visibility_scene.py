"""Random scenes of convex things on a table, and the exact answer: every ray cast at every part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsr.math3d.boxes import CORNERS
from dsr.math3d.shapes import Part, Shape, box
from dsr.math3d.surfaces import crossings
from dsr.math3d.transforms import Pose
from dsr.visibility import Body, placed
from dsr.visibility.picture import NEAREST
from dsr.vocabulary.intrinsics import Intrinsics

LENS = Intrinsics.from_fov(80, 60, 1.05)
TABLE = placed("table", box((1.2, 1.2, 0.04)), Pose((0.0, 0.0, -0.02)))


def random_things(rng: np.random.Generator, count: int) -> list[Body]:
    """Boxes, cylinders, balls and open boxes near the middle of the table, some of them leaning."""
    found = []
    for number in range(count):
        x, y, z = rng.uniform(0.03, 0.15, 3).tolist()
        pose = Pose.from_rotvec((*rng.uniform(-0.5, 0.5, 2), z / 2), rng.uniform(-1.0, 1.0, 3) * (number % 2, 1, 1))
        found.append(placed(f"thing_{number}", _shape(int(rng.integers(4)), (x, y, z)), pose))
    return found


def _shape(kind: int, size: tuple[float, float, float]) -> Shape:
    x, y, z = size
    if kind == 1:
        return (Part("cylinder", (x, x, z)),)
    if kind == 2:
        return (Part("sphere", (x, x, x)),)
    if kind == 3:
        return (
            Part("box", (x, y, 0.003), (0.0, 0.0, -z / 2)),
            Part("box", (0.003, y, z), (x / 2, 0.0, 0.0)),
            Part("box", (0.003, y, z), (-x / 2, 0.0, 0.0)),
        )
    return box(size)


def cast(view: Pose, intrinsics: Intrinsics, bodies: Sequence[Body]) -> dict[str, tuple[int, int]]:
    """(pixels, alone) of every body as `Glance` has them, by casting a ray through every pixel at every part."""
    across, down = intrinsics.width // 2, intrinsics.height // 2
    u, v = (
        grid.ravel()
        for grid in np.meshgrid(
            np.arange(-across, intrinsics.width + across), np.arange(-down, intrinsics.height + down)
        )
    )
    rays = intrinsics.rays(np.column_stack([u, v]))
    depths = np.array([_depth(view.translation, rays @ view.rotation_matrix.T, body) for body in bodies])
    inside = (u >= 0) & (u < intrinsics.width) & (v >= 0) & (v < intrinsics.height)
    first = depths.argmin(axis=0)
    return {
        body.name: (int((inside & hit & (first == k)).sum()), int(hit.sum()))
        for k, body in enumerate(bodies)
        for hit in [np.isfinite(depths[k])]
    }


def shares(view: Pose, intrinsics: Intrinsics, bodies: Sequence[Body], side: int = 24) -> dict[str, float]:
    """How much of every body is seen, by `side` x `side` rays spread over what it takes of the picture's plane.

    Nothing of it depends on pixels; what is beyond the picture's edges is not seen.
    """
    return {body.name: _share(view, intrinsics, bodies, body, side) for body in bodies}


def _share(view: Pose, intrinsics: Intrinsics, bodies: Sequence[Body], body: Body, side: int) -> float:
    solids = body.solids
    corners = solids.centre[:, None] + (CORNERS * solids.half[:, None]) @ solids.rotation.transpose(0, 2, 1)
    points = (corners.reshape(-1, 3) - view.translation) @ view.rotation_matrix
    if points[:, 2].min() <= NEAREST:
        return 0.0
    pixels = intrinsics.project(points)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    steps = (np.arange(side) + 0.5) / side
    u, v = (grid.ravel() for grid in np.meshgrid(*(low[k] + steps * (high[k] - low[k]) for k in range(2))))
    rays = intrinsics.rays(np.column_stack([u, v]))
    depths = np.array([_depth(view.translation, rays @ view.rotation_matrix.T, other) for other in bodies])
    own = depths[bodies.index(body)]
    hit = np.isfinite(own)
    inside = (u >= -0.5) & (u <= intrinsics.width - 0.5) & (v >= -0.5) & (v <= intrinsics.height - 0.5)
    return float((hit & inside & (own <= depths.min(axis=0))).sum() / max(1, hit.sum()))


def _depth(eye: np.ndarray, rays: np.ndarray, body: Body) -> np.ndarray:
    solids = body.solids
    start = np.einsum("nj,nji->ni", eye - solids.centre, solids.rotation)
    enters, leaves = crossings(solids.kinds, solids.half, start[:, None], rays[None] @ solids.rotation)
    return np.asarray(np.where((enters < leaves) & (enters > NEAREST), enters, np.inf).min(axis=0))
