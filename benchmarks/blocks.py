"""How well boxes and cylinders without tags are found by depth: `python -m benchmarks.perception --shapes`.

A block of each shape stands on a table in rendered frames of cameras all around it, turned at random. The peer is the
smallest rectangle around the points of the same piece of the image, seen from above, with the height of its highest
points: what a tutorial would do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from time import process_time  # CPU time is what is measured here
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from agents.frame_images import images
from agents.scenario.format.scenario import ObjectSpec, TableSpec
from agents.scene_estimator.blocks import Block, BlockFinder, KnownBlock, Support, upright_box
from agents.scene_estimator.blocks.block import BlockKind
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from benchmarks.color_scene import AWAY, ColorScene, looking_at
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose

BLOCKS = {
    "cube": (0.04, 0.04, 0.04),
    "box": (0.06, 0.04, 0.05),
    "tall_box": (0.05, 0.12, 0.2),
    "pale_box": (0.06, 0.04, 0.05),
    "can": (0.05, 0.05, 0.08),
}
"""Extents of the blocks, m; the can is a cylinder, and the pale box has nearly the colour of the table."""
_COLOR, _PALE = (0.8, 0.32, 0.28), (0.7, 0.6, 0.5)


class BlockResult(NamedTuple):
    """What was made of one frame."""

    found: bool
    right_shape: bool
    """It is one block, and of the right kind"""
    errors: dict[str, tuple[float, float]]
    """By method: distance of the centre (m), and the largest error of an extent (m)"""
    yaw: float
    """rad, error of the fit's yaw; not a number for what is round"""
    sigmas: float
    """Of the centre: the square of its error over its covariance, 3 on average if that is right"""
    seconds: tuple[float, float, float]
    """s of CPU: pieces of the image; a block that nobody knows; the same when it is known"""


def shape_rows(distances: list[float], trials: int, seed: int) -> Iterator[dict[str, Any]]:
    """A row for each shape and distance (m), in SI units."""
    rng = np.random.default_rng(seed)
    specs = [
        ObjectSpec(
            name=name, type="box", size=size, color=_color(name), position=(0.0, 0.0, -9.0), shape=_shape(name, size)
        )
        for name, size in BLOCKS.items()
    ]
    scene = ColorScene([], rng, specs)
    for name in BLOCKS:
        for distance in distances:
            results = [_trial(scene, name, distance, rng) for _ in range(trials)]
            yield _row(name, distance, results)
        scene.put(name, AWAY)
    scene.close()


def shape_table(rows: list[dict[str, Any]]) -> Table:
    """For people: mm, degrees, ms."""
    table = Table(
        title="Blocks without tags, by depth: median / 95 %",
        caption="rectangle: the smallest one around the points; ms of CPU: pieces + a new block, a known one",
    )
    headings = ("block", "distance", "found", "wrong shape", "centre mm", "extent mm", "yaw deg", "NEES (3)")
    for heading in (*headings, "rectangle: centre mm", "extent mm", "ms"):
        table.add_column(heading, justify="right")
    for row in rows:
        pieces, new, known = (1e3 * row[f"{name}_s"] for name in ("pieces", "new", "known"))
        table.add_row(
            row["block"], f"{row['distance_m']} m", f"{row['found']}/{row['trials']}", str(row["wrong_shape"]),
            _pair(row["centre_m"], 1e3), _pair(row["extent_m"], 1e3), _pair(row["yaw_rad"], 180.0 / math.pi),
            f"{row['nees']:.1f}", _pair(row["rectangle_centre_m"], 1e3), _pair(row["rectangle_extent_m"], 1e3),
            f"{pieces:.0f} + {new:.0f}, {known:.0f}",
        )  # fmt: skip
    return table


def _color(name: str) -> tuple[float, float, float]:
    return _PALE if name == "pale_box" else _COLOR


def _kind(name: str) -> BlockKind:
    return "cylinder" if name == "can" else "cube" if name == "cube" else "box"


def _shape(name: str, size: tuple[float, float, float]) -> tuple[Part, ...]:
    return (Part("cylinder", size),) if name == "can" else ()


def _trial(scene: ColorScene, name: str, distance: float, rng: np.random.Generator) -> BlockResult:
    size = BLOCKS[name]
    x, y, yaw = rng.uniform((0.25, -0.1, -np.pi / 4), (0.45, 0.1, np.pi / 4))
    truth = Block(_kind(name), x, y, yaw, size, 0.0)
    scene.put(name, Pose.from_rotvec(truth.centre, (0.0, 0.0, yaw)))
    camera = looking_at(truth.centre, distance, rng)
    color, depth, intrinsics = images(scene.frame(camera))
    assert depth is not None
    return _looked(FrameView(depth, intrinsics, camera), color, truth)


def _looked(view: FrameView, color: NDArray[np.uint8], truth: Block) -> BlockResult:
    finder, table = BlockFinder(NoiseModel()), TableSpec()
    support = Support("table", Pose(table.position), table.size[0], table.size[1])
    times = [process_time()]
    clusters = finder.clusters(view, color, [support])
    times.append(process_time())
    if not clusters:
        return BlockResult(False, False, {}, math.nan, math.nan, (times[1] - times[0], 0.0, 0.0))
    cluster = max(clusters, key=lambda one: len(one.points))
    likely = finder.most_likely(view, cluster)
    times.append(process_time())
    sighting = min(likely, key=lambda one: math.dist(one.block.centre, truth.centre), default=None)
    if sighting is None:
        return BlockResult(False, False, {}, math.nan, math.nan, (times[1] - times[0], times[2] - times[1], 0.0))
    sigma_x, sigma_y, sigma_z = sighting.size_sigma.tolist()
    finder.fit(view, cluster, KnownBlock(sighting.block, (sigma_x, sigma_y, sigma_z)))
    times.append(process_time())
    found, peer = (_alike(block, truth) for block in (sighting.block, upright_box(cluster)))
    off = np.array(found.centre) - truth.centre
    nees = float(off @ np.linalg.solve(sighting.covariance[:3, :3], off))
    turned = math.nan if truth.is_round else abs(math.remainder(found.yaw - truth.yaw, math.pi))
    errors = {"fit": _errors(found, truth), "rectangle": _errors(peer, truth)}
    first, second, third = np.diff(times).tolist()
    is_right = found.kind == truth.kind and len(likely) == 1
    return BlockResult(True, is_right, errors, turned, nees, (first, second, third))


def _alike(block: Block, truth: Block) -> Block:
    """With its axes named as those of the truth, as nearly as can be."""
    if truth.is_round:
        return block
    return min(
        map(block.turned, range(4)),
        key=lambda one: (round(math.dist(one.size, truth.size), 3), abs(math.remainder(one.yaw - truth.yaw, math.pi))),
    )


def _errors(block: Block, truth: Block) -> tuple[float, float]:
    return math.dist(block.centre, truth.centre), float(np.abs(np.subtract(block.size, truth.size)).max())


def _row(name: str, distance: float, results: list[BlockResult]) -> dict[str, Any]:
    found = [result for result in results if result.found]
    row: dict[str, Any] = {"block": name, "distance_m": distance, "found": len(found), "trials": len(results)}
    row["wrong_shape"] = sum(not result.right_shape for result in found)
    for method, prefix in (("fit", ""), ("rectangle", "rectangle_")):
        for k, what in enumerate(("centre_m", "extent_m")):
            row[prefix + what] = _quantiles([result.errors[method][k] for result in found])
    row["yaw_rad"] = _quantiles([result.yaw for result in found])
    row["nees"] = float(np.mean([result.sigmas for result in found])) if found else math.nan
    for k, what in enumerate(("pieces_s", "new_s", "known_s")):
        row[what] = float(np.median([result.seconds[k] for result in results]))
    return row


def _quantiles(errors: list[float]) -> tuple[float, float] | None:
    """Median and 95 % of those that are known."""
    known = [error for error in errors if not math.isnan(error)]
    return (float(np.quantile(known, 0.5)), float(np.quantile(known, 0.95))) if known else None


def _pair(values: tuple[float, float] | None, factor: float) -> str:
    return "-" if values is None else " / ".join(f"{value * factor:.2f}" for value in values)
