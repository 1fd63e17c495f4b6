"""The board beside a tag, taken as a box without tags: which way it faces, and how alike its extents are everywhere."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from agents.scene_estimator.blocks import Block, BlockFinder, Cluster, Support, upright_box
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from benchmarks.real.drawing import draw_outline
from benchmarks.real.recordings import Outcome, RealBenchmark, quantiles
from benchmarks.real.tags import BENCHMARK as TAGS
from benchmarks.real.tags import LENS, board_normal, picture_pairs, read_pair
from dsr.math3d.transforms import Array, Pose

_NEAREST, _FARTHEST = 0.3, 2.5
"""m, between which the table is looked for"""
_SPARSE = 4
"""px apart, of the depths that are used for that"""
_LEVEL = 0.7
"""Least cosine between up in the image and up in the world: the camera looks down by 45 deg at most."""
_FLAT = 0.01
"""m that points of the table may be off its plane"""
_DRAWS = 400
"""Planes through three points that are tried: one point in four on the table would do with a tenth of them"""
_EDGES = 0.005
"""Share of the table's points at each side that may be outside it"""


class _Seen(NamedTuple):
    """One image."""

    box: Block | None
    """As it was fitted; None if the largest piece on the table is no block"""
    rectangle: Block
    """The smallest rectangle around its points, from above"""
    facing: float | None
    """rad, in the world, which way the chessboard faces; None if it is not seen"""
    picture: NDArray[np.uint8]
    """(h, w, 3) RGB"""
    view: FrameView
    piece: Cluster
    """The largest piece on the table"""


def run(folder: Path) -> Outcome:
    """Find the board in every image."""
    pairs, different = picture_pairs(folder)
    found = [one for path in different if (one := _look(path)) is not None]
    rows: dict[str, list[tuple[Block | None, float | None]]] = {
        "ours": [(one.box, one.facing) for one in found],
        "smallest rectangle": [(one.rectangle, one.facing) for one in found],
    }
    headings = ("method", "found", "facing: median deg", "95 % deg", "width mm", "95 % off", "height mm", "95 % off")
    table, figures = Table(*headings), {}
    for name, seen in rows.items():
        boxes = [box for box, _ in seen if box is not None]
        turned = [_turned(box, facing) for box, facing in seen if box is not None and facing is not None]
        median, most = quantiles(turned, 0.5, 0.95)
        (width, width_off), (height, height_off) = (
            _spread([max(box.size[:2]) for box in boxes]), _spread([box.size[2] for box in boxes])
        )  # fmt: skip
        figures[name] = {
            "found": len(boxes), "facing_median_deg": median, "facing_p95_deg": most, "width_m": width,
            "width_off_p95_m": width_off, "height_m": height, "height_off_p95_m": height_off,
        }  # fmt: skip
        lengths = (f"{1e3 * value:.0f}" for value in (width, width_off, height, height_off))
        table.add_row(name, str(len(boxes)), f"{median:.2f}", f"{most:.2f}", *lengths)
    remarks = [
        f"{pairs} pairs of images, {len(different)} different; a table with something on it in {len(found)}.",
        "The board is the same in all images: `off` is how far its extents are from their median.",
    ]
    counts = {"pairs": pairs, "different": len(different), "used": len(found)}
    return Outcome(table, remarks, {**counts, "methods": figures})


def draw(folder: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Each image with the edge of the largest piece on the table, and the outline of the block fitted to it."""
    for path in picture_pairs(folder)[1]:
        one = _look(path)
        if one is not None and one.box is not None:
            picture = np.asarray(cv2.cvtColor(one.picture, cv2.COLOR_RGB2BGR), np.uint8)
            draw_outline(picture, one.piece.contour, one.box.outline(one.view))
            yield f"{'-'.join(path.relative_to(folder).with_suffix('').parts)}.png", picture


def _look(path: Path) -> _Seen | None:
    """The largest piece on the table; None if there is no table, or nothing on it."""
    rgb, depth = read_pair(path)
    placed = _table(depth, np.random.default_rng(0))
    if placed is None:
        return None
    camera, support = placed
    view, finder = FrameView(depth, LENS, camera), BlockFinder(NoiseModel())
    pieces = finder.clusters(view, rgb, [support])
    if not pieces:
        return None
    piece = max(pieces, key=lambda one: len(one.points))
    sighting, normal = finder.fit(view, piece), board_normal(rgb)
    facing = None
    if normal is not None:
        x, y, _ = (camera.rotation_matrix @ normal).tolist()
        facing = math.atan2(y, x)
    return _Seen(None if sighting is None else sighting.block, upright_box(piece), facing, rgb, view, piece)


def _table(depth: NDArray[np.float32], rng: np.random.Generator) -> tuple[Pose, Support] | None:
    """world_from_camera with the table at height 0, and the table: the level plane with most points."""
    v, u = np.mgrid[0 : depth.shape[0] : _SPARSE, 0 : depth.shape[1] : _SPARSE]
    z = depth[::_SPARSE, ::_SPARSE]
    near = (z > _NEAREST) & (z < _FARTHEST)
    pixels = np.column_stack([u[near], v[near]]).astype(np.float64)
    points = LENS.rays(pixels) * z[near].astype(np.float64)[:, None]
    on = np.zeros(len(points), bool)
    for _ in range(_DRAWS if len(points) else 0):
        a, b, c = points[rng.integers(len(points), size=3)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if abs(normal[1]) > _LEVEL * length:
            tried = np.abs((points - a) @ normal) < _FLAT * length
            on = tried if tried.sum() > on.sum() else on
    if not on.any():
        return None
    middle = points[on].mean(axis=0)
    up = np.linalg.svd(points[on] - middle, full_matrices=False)[2][2]
    up = -up if up[1] > 0.0 else up
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead /= np.linalg.norm(ahead)
    turn = np.stack([ahead, np.cross(up, ahead), up])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, -turn @ middle
    low, high = np.quantile(((points[on] - middle) @ turn.T)[:, :2], [_EDGES, 1.0 - _EDGES], axis=0)
    x, y = (0.5 * (low + high)).tolist()
    length, width = (high - low).tolist()
    return Pose.from_matrix(matrix), Support("table", Pose((x, y, 0.0)), length, width)


def _turned(box: Block, facing: float) -> float:
    """How far the wide face of a box is turned from `facing` (rad), deg."""
    across = box.yaw + (0.5 * math.pi if box.size[0] > box.size[1] else 0.0)
    return abs(math.degrees(math.remainder(across - facing, math.pi)))


def _spread(lengths: list[float]) -> tuple[float, float]:
    """The median, and the 95 % quantile of how far they are from it, m."""
    values: Array = np.array(lengths)
    middle = quantiles(lengths, 0.5)[0]
    return middle, quantiles(list(np.abs(values - middle)), 0.95)[0]


BENCHMARK = RealBenchmark(
    "boxes",
    "A cardboard board on a table, found without its tag as a box; a chessboard on it tells which way it faces.",
    TAGS.published,
    run,
    draw,
)
