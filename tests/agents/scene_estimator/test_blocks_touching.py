"""Blocks that touch from the beginning, of two colours or of one: each is found, unless nothing tells them apart."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np
import pytest

from agents.scenario.format.scenario import ObjectSpec
from agents.scene_estimator.blocks import Block, BlockFinder, BlockSighting, UntaggedObjects, cut
from agents.scene_estimator.blocks.block import inside
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.pose import NoiseModel
from benchmarks.color_scene import AWAY
from dsr import Memory, Pose
from dsr.math3d import transforms
from dsr.math3d.shapes import Part

from .block_scene import ABOVE, BLUE, RED, BlockScene

SPECS = {
    "red": ObjectSpec(name="red", type="box", size=(0.06, 0.04, 0.05), color=RED, position=AWAY.t),
    "low": ObjectSpec(name="low", type="box", size=(0.08, 0.06, 0.03), color=RED, position=AWAY.t),
    "tall": ObjectSpec(name="tall", type="box", size=(0.04, 0.04, 0.09), color=RED, position=AWAY.t),
    "twin": ObjectSpec(name="twin", type="box", size=(0.06, 0.04, 0.05), color=RED, position=AWAY.t),
    "can": ObjectSpec(
        name="can", type="box", size=(0.05, 0.05, 0.07), color=RED, position=AWAY.t,
        shape=(Part("cylinder", (0.05, 0.05, 0.07)),),
    ),
    "blue": ObjectSpec(name="blue", type="box", size=(0.06, 0.04, 0.05), color=BLUE, position=AWAY.t),
}  # fmt: skip
CAMERA = transforms.looking_at((-0.05, 0.1, 0.6), (0.35, 0.0, 0.0))


@pytest.fixture(params=range(3))
def scene(rendered_blocks: BlockScene, request: pytest.FixtureRequest) -> BlockScene:
    """An empty table, and the blocks that a test may stand on it: each test sees them with several noises."""
    rendered_blocks.begin(noise=request.param)
    return rendered_blocks


def find(scene: BlockScene, camera: Pose, nearer: dict[str, float] | None = None) -> list[BlockSighting]:
    view, _, clusters = scene.look(camera, nearer)
    return [one for cluster in clusters for one in BlockFinder(NoiseModel()).most_likely(view, cluster)]


def assert_found(found: Sequence[BlockSighting], truths: Sequence[Block]) -> None:
    """Each where it is, as far as the errors of all its depths allow, with its extents, which are known surely."""
    assert len(found) == len(truths)
    for truth in truths:
        one = min(found, key=lambda sighting: math.dist(sighting.block.centre, truth.centre))
        assert one.size_sigma.max() < SceneEstimatorConfig().blocks_sure
        assert math.dist(one.block.centre, truth.centre) < NoiseModel().depth_bias_std
        turned = [one.block.turned(quarters).size for quarters in range(2)]
        assert min(np.abs(np.subtract(size, truth.size)).max() for size in turned) < 0.005


def test_where_blocks_of_two_colours_meet_both_end(rendered_blocks: BlockScene) -> None:
    """Of one noise in fourteen an extent is off by more than 2 mm: the median over several counts."""
    off: dict[tuple[int, int], list[np.ndarray]] = {}
    for noise in range(3):
        rendered_blocks.begin(noise=noise)
        truths = [rendered_blocks.stand("red", 0.35, 0.0), rendered_blocks.stand("blue", 0.34, 0.041)]
        for case, nearer in enumerate(({}, {"red": 0.012}, {"blue": 0.012})):
            found = find(rendered_blocks, ABOVE, nearer)
            assert len(found) == 2
            for number, truth in enumerate(truths):  # from above nothing tells an error of all depths from a height
                one = min(found, key=lambda sighting: math.dist(sighting.block.centre, truth.centre))
                assert one.hidden > 0.15
                assert one.size_sigma[:2].max() < 0.003
                assert math.dist(one.block.centre[:2], truth.centre[:2]) < 0.002
                sizes = np.subtract(sorted(one.block.size[:2]), sorted(truth.size[:2]))
                off.setdefault((case, number), []).append(sizes)
    assert all(np.abs(np.median(sizes, axis=0)).max() < 0.002 for sizes in off.values())


def test_how_far_a_block_goes_on_behind_another_is_unsure_as_seen_from_the_side(scene: BlockScene) -> None:
    scene.stand("red", 0.35, 0.0)
    scene.stand("blue", 0.34, 0.041)
    slack = [
        max(
            float(cluster.contour_sigma.max())
            for cluster in scene.look(transforms.looking_at(eye, (0.35, 0.0, 0.0))).clusters
        )
        for eye in ((0.35, 0.0, 0.65), (0.0, 0.0, 0.55))
    ]
    assert 0.0 < slack[0] < 0.5 * slack[1]


def test_a_block_goes_on_under_what_stands_on_it(scene: BlockScene) -> None:
    """Its edge is hidden there: what ends is the upper block."""
    scene.stand("low", 0.35, 0.0)
    scene.put("blue", Pose((0.36, 0.01, 0.03 + 0.025)))
    lower = min(scene.look(CAMERA).clusters, key=lambda cluster: math.dist(cluster.color, RED))
    assert lower.hidden > 0.0
    assert (lower.contour_sigma == 0.0).all()


@pytest.mark.parametrize("names", [("red", "low"), ("red", "tall"), ("red", "can")])
@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_two_blocks_of_one_colour_that_differ_are_two(scene: BlockScene, names: tuple[str, str], yaw: float) -> None:
    first, second = (SPECS[name].size for name in names)
    along, across = 0.5 * (first[0] + second[0]) + 0.001, 0.01
    c, s = math.cos(yaw), math.sin(yaw)
    truths = [
        scene.stand(names[0], 0.33, 0.0, yaw),
        scene.stand(names[1], 0.33 + c * along - s * across, s * along + c * across, yaw),
    ]
    found = find(scene, CAMERA, {names[0]: 0.004})
    assert_found(found, truths)
    assert [one.block.is_round for one in found].count(True) == names.count("can")


def test_the_edges_of_two_of_one_colour_are_their_own(scene: BlockScene) -> None:
    """Depth is missing at the foot of one, and on the steep side of the other: none of that is an edge of both."""
    truths = [scene.stand("red", 0.33, 0.0), scene.stand("low", 0.401, 0.01)]
    view, _, clusters = scene.look(CAMERA, {"red": 0.004})
    assert len(clusters) == 2
    for truth in truths:
        outline = truth.outline(view)
        assert min(float(np.abs(inside(outline, cluster.contour)).max()) for cluster in clusters) < 3.0


def test_a_piece_is_cut_where_one_block_ends(scene: BlockScene) -> None:
    truths = [scene.stand("red", 0.33, 0.0), scene.stand("tall", 0.381, 0.01)]
    (cluster,) = scene.look(CAMERA, {"red": 0.004}).clusters
    halves = cut(cluster)
    assert halves is not None
    assert all(math.dist((one.x, one.y), (truth.x, truth.y)) < 0.006 for one, truth in zip(halves, truths, strict=True))


def test_two_alike_side_by_side_are_one_if_nothing_tells_them_apart(scene: BlockScene) -> None:
    scene.stand("red", 0.35, 0.0)
    scene.stand("twin", 0.35, 0.0405)
    (one,) = find(scene, CAMERA)
    assert sorted(one.block.size) == pytest.approx([0.05, 0.06, 0.08], abs=0.005)


@pytest.mark.parametrize("name", ["red", "low", "tall", "can"])
def test_one_block_is_not_cut_in_two(scene: BlockScene, name: str) -> None:
    for yaw in (0.0, 0.4, 1.1):
        truth = scene.stand(name, 0.35, 0.0, yaw)
        view, _, (cluster,) = scene.look(CAMERA)
        assert_found(BlockFinder(NoiseModel()).most_likely(view, cluster), [truth])
        assert name == "can" or cut(cluster) is None


def test_two_of_one_colour_that_touch_from_the_beginning_become_two_nodes(scene: BlockScene, memory: Memory) -> None:
    c, s = math.cos(0.3), math.sin(0.3)
    truths = [
        scene.stand("red", 0.33, 0.0, 0.3),
        scene.stand("tall", 0.33 + 0.051 * c - 0.01 * s, 0.051 * s + 0.01 * c, 0.3),
    ]
    assert 0.0 < truths[0].gap(truths[1]) < 0.004
    config = SceneEstimatorConfig(blocks=True)
    objects = UntaggedObjects(memory, config, logging.getLogger("test"))
    percepts: dict[str, Pose] = {}
    for frame in range(config.blocks_after + 4):
        view, color, _ = scene.look(CAMERA)
        stamp = 0.1 * (frame + 1)
        blocks = objects.read(view, color, stamp, stamp, [])
        percepts = dict(objects.consider("camera", blocks, stamp))
        for name, pose in percepts.items():
            memory.add_edge("world", name, "RT", pose=CAMERA @ pose)
    assert len(percepts) == len(memory.nodes("box")) == 2
    for truth in truths:
        assert min(math.dist((CAMERA @ pose).t, truth.centre) for pose in percepts.values()) < 0.005
    objects.close()


def test_gaps_of_blocks_seen_from_above() -> None:
    box, can = Block("box", 0.0, 0.0, 0.3, (0.06, 0.04, 0.05), 0.0), Block("cylinder", 0.0, 0.0, 0.0, (0.05,) * 3, 0.0)
    c, s = math.cos(0.3), math.sin(0.3)
    beside = box._replace(x=0.065 * c, y=0.065 * s)
    assert box.gap(beside) == beside.gap(box) == pytest.approx(0.005)
    assert box.gap(beside._replace(x=0.05 * c, y=0.05 * s)) == pytest.approx(-0.01)
    assert box.gap(can._replace(x=-0.06 * s, y=0.06 * c)) == pytest.approx(0.06 - 0.02 - 0.025)
    assert can.gap(can._replace(x=0.03, y=0.04)) == pytest.approx(0.0)
