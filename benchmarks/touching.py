"""How well boxes without tags that touch are told apart: `python -m benchmarks.perception --touching`.

Two boxes of random extents stand side by side on a table, a millimetre apart, one shifted along the other, in rendered
frames of cameras all around them. All depths of a box are up to 15 mm too small, as in the scenarios. The peer takes
each piece of one colour for one block.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from time import process_time  # CPU time is what is measured here
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from agents.frame_images import images
from agents.scenario.format.scenario import ObjectSpec, TableSpec
from agents.scene_estimator.blocks import Block, BlockFinder, BlockSighting, Support
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from benchmarks.color_scene import AWAY, ColorScene, looking_at
from dsr.math3d.transforms import Pose

_SIZES = ((0.04, 0.04, 0.04), (0.06, 0.04, 0.05), (0.05, 0.08, 0.1), (0.04, 0.04, 0.08), (0.08, 0.06, 0.03))  # m
_COLORS = {"one": ((0.85, 0.2, 0.15), (0.85, 0.2, 0.15)), "two": ((0.85, 0.2, 0.15), (0.15, 0.3, 0.9))}
_GAP = 0.001  # m
_SHIFTED = 0.4  # of the width of the first, at most
_MOST_BIAS = 0.015  # m
_WRONG = 0.006  # m, error of an extent beyond which a block is another one for who grasps it


class PairResult(NamedTuple):
    """What was made of the boxes of one frame by one method."""

    centres: list[float]
    """m, errors of those that are found surely: of which the extents are known as well as a new node's must be"""
    extents: list[float]
    """m, greatest error of an extent of each"""
    seconds: float
    """s of CPU"""


def pair_rows(distances: list[float], trials: int, seed: int) -> Iterator[dict[str, Any]]:
    """A row for each count of colours, distance (m) and method, in SI units."""
    for colors, pair in _COLORS.items():
        rng = np.random.default_rng(seed)
        specs = [
            ObjectSpec(name=f"{side}_{k}", type="box", size=size, color=pair[side], position=AWAY.t)
            for side in range(2)
            for k, size in enumerate(_SIZES)
        ]
        scene = ColorScene([], rng, specs)
        for distance in distances:
            results = [_trial(scene, distance, rng) for _ in range(trials)]
            for k, method in enumerate(("ours", "one block each")):
                yield _row(colors, distance, method, [result[k] for result in results])
        scene.close()


def pair_table(rows: list[dict[str, Any]]) -> Table:
    """For people: mm, ms."""
    table = Table(title="Two blocks that touch, by depth: median / 95 %")
    for heading in ("colours", "distance", "method", "sure", "of them wrong", "centre mm", "extent mm", "ms"):
        table.add_column(heading, justify="right")
    for row in rows:
        centre, extent = (_pair(row[name]) for name in ("centre_m", "extent_m"))
        table.add_row(
            row["colours"], f"{row['distance_m']} m", row["method"], f"{row['sure']}/{row['blocks']}",
            str(row["wrong"]), centre, extent, f"{1e3 * row['seconds']:.0f}",
        )  # fmt: skip
    return table


def _row(colors: str, distance: float, method: str, results: list[PairResult]) -> dict[str, Any]:
    centres = [error for one in results for error in one.centres]
    extents = [error for one in results for error in one.extents]
    return {
        "colours": colors, "distance_m": distance, "method": method, "blocks": 2 * len(results), "sure": len(centres),
        "wrong": sum(error > _WRONG for error in extents), "centre_m": _quantiles(centres),
        "extent_m": _quantiles(extents), "seconds": float(np.median([one.seconds for one in results])),
    }  # fmt: skip


def _trial(scene: ColorScene, distance: float, rng: np.random.Generator) -> tuple[PairResult, PairResult]:
    names = [f"{side}_{rng.integers(len(_SIZES))}" for side in range(2)]
    truths = _side_by_side([_SIZES[int(name[2:])] for name in names], rng)
    for name, truth in zip(names, truths, strict=True):
        scene.put(name, Pose.from_rotvec(truth.centre, (0.0, 0.0, truth.yaw)))
    camera = looking_at(truths[0].centre, distance, rng)
    frame = scene.frame(camera, dict(zip(names, rng.uniform(0.0, _MOST_BIAS, 2).tolist(), strict=True)))
    for name in names:
        scene.put(name, AWAY)
    color, depth, intrinsics = images(frame)
    assert depth is not None
    view, table, finder = FrameView(depth, intrinsics, camera), TableSpec(), BlockFinder(NoiseModel())
    clusters = finder.clusters(view, color, [Support("table", Pose(table.position), table.size[0], table.size[1])])
    began = process_time()
    ours = [sighting for cluster in clusters for sighting in finder.most_likely(view, cluster)]
    between = process_time()
    singles = [sighting for cluster in clusters if (sighting := finder.fit(view, cluster)) is not None]
    ended = process_time()
    return _judged(ours, truths, between - began), _judged(singles, truths, ended - between)


def _side_by_side(sizes: Sequence[tuple[float, float, float]], rng: np.random.Generator) -> list[Block]:
    """Two boxes of these extents (m) that touch with one side each, anywhere."""
    first, second = sizes
    x, y, yaw = rng.uniform((0.28, -0.06, -math.pi), (0.42, 0.06, math.pi))
    along, across = 0.5 * (first[0] + second[0]) + _GAP, rng.uniform(-_SHIFTED, _SHIFTED) * first[1]
    c, s = math.cos(yaw), math.sin(yaw)
    there = x + c * along - s * across, y + s * along + c * across
    return [Block("box", x, y, yaw, first, 0.0), Block("box", *there, yaw, second, 0.0)]


def _judged(sightings: Sequence[BlockSighting], truths: Sequence[Block], seconds: float) -> PairResult:
    """Each is compared with the true box that is nearest."""
    sure = [one.block for one in sightings if one.size_sigma.max() <= SceneEstimatorConfig().blocks_sure]
    pairs = [(one, _nearest(one, truths)) for one in sure]
    extents = [
        min(float(np.abs(np.subtract(one.turned(quarters).size, truth.size)).max()) for quarters in range(2))
        for one, truth in pairs
    ]
    return PairResult([math.dist(one.centre, truth.centre) for one, truth in pairs], extents, seconds)


def _nearest(block: Block, truths: Sequence[Block]) -> Block:
    return min(truths, key=lambda truth: math.dist(truth.centre, block.centre))


def _pair(values: tuple[float, float] | None) -> str:
    """In mm"""
    return "-" if values is None else " / ".join(f"{1e3 * value:.1f}" for value in values)


def _quantiles(errors: list[float]) -> tuple[float, float] | None:
    """Median and 95 %."""
    return (float(np.quantile(errors, 0.5)), float(np.quantile(errors, 0.95))) if errors else None
