"""Blocks without tags in rendered images: found where they are, as sure as they are, and the same ones again."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from agents.scenario.format.scenario import ObjectSpec, TableSpec
from agents.scene_estimator.blocks import (
    Block,
    BlockFinder,
    BlockSighting,
    BlockTrack,
    KnownBlock,
    KnownVolume,
    UntaggedObjects,
    assigned,
    upright_box,
)
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.pose import NoiseModel
from benchmarks.color_scene import AWAY, looking_at
from dsr import Memory, Pose
from dsr.math3d import transforms
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, from_numbers

from .block_scene import ABOVE, BLUE, RED, BlockScene
from .conftest import AGE, PERIOD, Bench

BOX: Vector3 = (0.06, 0.04, 0.05)
CAN: Vector3 = (0.05, 0.05, 0.08)
SCREEN: Vector3 = (0.02, 0.2, 0.2)
CUBE: Vector3 = (0.04, 0.04, 0.04)
GREEN, PALE = (0.2, 0.7, 0.25), (0.7, 0.6, 0.5)
SPECS = {
    "red": ObjectSpec(name="red", type="box", size=BOX, color=RED, position=AWAY.t),
    "blue": ObjectSpec(name="blue", type="box", size=BOX, color=BLUE, position=AWAY.t),
    "other_blue": ObjectSpec(name="other_blue", type="box", size=BOX, color=BLUE, position=AWAY.t),
    "cube": ObjectSpec(name="cube", size=CUBE, color=RED, position=AWAY.t),
    "pale": ObjectSpec(name="pale", type="box", size=BOX, color=PALE, position=AWAY.t),
    "can": ObjectSpec(name="can", type="box", size=CAN, color=GREEN, position=AWAY.t, shape=(Part("cylinder", CAN),)),
    "screen": ObjectSpec(name="screen", type="box", size=SCREEN, color=(0.7, 0.1, 0.7), position=AWAY.t),
}
EYE = (-0.2, 0.0, 0.65)
CAMERA = transforms.looking_at(EYE, (0.35, 0.0, 0.0))


def find(scene: BlockScene, camera: Pose = CAMERA, known: KnownBlock | None = None) -> list[BlockSighting]:
    view, _, clusters = scene.look(camera)
    fits = [BlockFinder(NoiseModel()).fit(view, cluster, known) for cluster in clusters]
    return [fit for fit in fits if fit is not None]


def off(sighting: BlockSighting, truth: Block) -> float:
    return math.dist(sighting.block.centre, truth.centre)


def test_an_empty_table_holds_nothing(scene: BlockScene) -> None:
    assert scene.look(CAMERA).clusters == []


@pytest.mark.parametrize("distance", [0.6, 1.0])
def test_boxes_are_found_with_extents_and_an_honest_covariance(scene: BlockScene, distance: float) -> None:
    rng, nees = np.random.default_rng(1), []
    for _ in range(6):
        x, y, yaw = rng.uniform((0.25, -0.1, -0.7), (0.45, 0.1, 0.7))
        truth = scene.stand("red", x, y, yaw)
        (sighting,) = find(scene, looking_at(truth.centre, distance, rng))
        assert sighting.block.kind == "box"
        assert off(sighting, truth) < 0.005
        assert sorted(sighting.block.size[:2]) == pytest.approx([0.04, 0.06], abs=0.003)
        error = np.subtract(sighting.block.centre, truth.centre)
        nees.append(error @ np.linalg.solve(sighting.covariance[:3, :3], error))
    assert np.mean(nees) < 9.0  # 3 if exactly right


def test_a_cylinder_is_told_from_a_box(scene: BlockScene) -> None:
    truth = scene.stand("can", 0.3, 0.05)
    (sighting,) = find(scene)
    assert sighting.block.kind == "cylinder"
    assert off(sighting, truth) < 0.005
    assert sighting.block.size == pytest.approx(CAN, abs=0.004)
    (part,) = sighting.block.shape
    assert part.kind == "cylinder"


def test_a_cube_is_told_from_a_box(scene: BlockScene) -> None:
    truth = scene.stand("cube", 0.3, 0.05)
    (sighting,) = find(scene)
    assert sighting.block.kind == "cube"
    assert off(sighting, truth) < 0.002
    assert sighting.block.size == pytest.approx(CUBE, abs=0.001)


@pytest.mark.parametrize("distance", [0.6, 1.0])
def test_the_edges_of_a_block_that_looks_like_the_table_are_unsure(scene: BlockScene, distance: float) -> None:
    rng, nees = np.random.default_rng(2), []
    for _ in range(6):
        x, y, yaw = rng.uniform((0.25, -0.1, -0.7), (0.45, 0.1, 0.7))
        truth = scene.stand("pale", x, y, yaw)
        (sighting,) = find(scene, looking_at(truth.centre, distance, rng))
        assert off(sighting, truth) < 0.01
        error = np.subtract(sighting.block.centre, truth.centre)
        nees.append(error @ np.linalg.solve(sighting.covariance[:3, :3], error))
    assert np.mean(nees) < 9.0  # 3 if exactly right


@pytest.mark.parametrize("lean", [-0.09, 0.06])
def test_a_board_that_leans_has_its_extents(scene: BlockScene, lean: float) -> None:
    """Upright it would have to be nearer than its depths tell, and smaller."""
    foot, turn = (0.35, 0.02, 0.0), Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, lean, 0.0))
    leaning = Pose(foot) @ turn @ Pose((0.0, 0.0, 0.5 * SCREEN[2]))
    scene.put("screen", leaning)
    sightings = find(scene)
    found = max(sightings, key=lambda sighting: sighting.block.size[2])
    assert sorted(found.block.size) == pytest.approx(sorted(SCREEN), abs=0.005)
    assert math.dist(found.block.centre, leaning.t) < 0.005
    assert not found.strained


def test_a_known_block_is_found_wherever_it_is_lifted_to(scene: BlockScene) -> None:
    known = KnownBlock(scene.stand("red", 0.35, 0.03, 0.2), (0.0005, 0.0005, 0.0005))
    for base in (0.0, 0.05, 0.15):
        truth = scene.stand("red", 0.35, 0.03, 0.2, base)
        view, _, (cluster,) = scene.look(ABOVE)
        sighting = BlockFinder(NoiseModel()).fit_unchanged(view, cluster, known)
        assert sighting is not None
        assert off(sighting, truth) < 0.006
        assert not sighting.measured
        on_table = BlockFinder(NoiseModel()).fit(view, cluster, known)
        assert on_table is None or base == 0.0 or on_table.cost > sighting.cost


def test_neighbours_of_other_colours_are_two_blocks(scene: BlockScene) -> None:
    truths = [scene.stand("red", 0.3, 0.02), scene.stand("blue", 0.3, -0.021)]
    found = find(scene)
    assert len(found) == 2
    for truth in truths:
        assert min(off(sighting, truth) for sighting in found) < 0.006


def test_what_is_hidden_is_unsure_unless_it_was_known(scene: BlockScene) -> None:
    truth = scene.stand("red", 0.35, 0.0)
    (whole,) = find(scene)
    scene.stand("screen", 0.24, 0.115)
    part = min(find(scene), key=lambda sighting: off(sighting, truth))
    assert part.hidden > 0.15 > whole.hidden
    assert part.size_sigma.max() > 2.0 * whole.size_sigma.max()
    x, y, z = whole.size_sigma.tolist()
    view, _, clusters = scene.look(CAMERA)
    known = KnownBlock(whole.block, (x, y, z))
    again = [BlockFinder(NoiseModel()).fit(view, cluster, known) for cluster in clusters]
    assert min(off(sighting, truth) for sighting in again if sighting is not None) < 0.006


def test_the_first_guess_is_the_smallest_rectangle(scene: BlockScene) -> None:
    truth = scene.stand("red", 0.3, 0.0, 0.4)
    (cluster,) = scene.look(CAMERA).clusters
    assert math.dist(upright_box(cluster).centre, truth.centre) < 0.01


def seen(block: Block, color: Vector3, sigma: float = 0.001) -> BlockSighting:
    return BlockSighting(block, sigma**2 * np.eye(7), color, 0.02, 0.0, measured=True, strained=False, cost=0.0)


def track(name: str, block: Block, color: Vector3) -> BlockTrack:
    return BlockTrack(name, block, np.full(3, 0.001), color)


def test_blocks_keep_their_names_when_they_change_places_but_not_if_they_look_alike() -> None:
    here, there = Block("box", 0.3, 0.1, 0.0, BOX, 0.0), Block("box", 0.3, -0.1, 0.0, BOX, 0.0)
    red, green = track("red", here, RED), track("green", there, GREEN)
    assert assigned([red, green], [seen(here, GREEN), seen(there, RED)]) == [green, red]
    one, other = track("one", here, BLUE), track("other", there, BLUE)
    assert assigned([one, other], [seen(here, BLUE), seen(there, BLUE)]) == [one, other]


def test_another_size_or_shape_is_another_block() -> None:
    block = Block("box", 0.3, 0.1, 0.0, BOX, 0.0)
    known = track("red", block, RED)
    larger, round_one = block._replace(size=(0.06, 0.04, 0.09)), block._replace(kind="cylinder")
    assert assigned([known], [seen(larger, RED)]) == [None]
    assert assigned([known], [seen(round_one, RED)]) == [None]
    assert assigned([known], [seen(block.turned(1), RED)]) == [known]


def test_axes_keep_their_names_and_extents_are_averaged() -> None:
    known = track("red", Block("box", 0.3, 0.1, 0.1, BOX, 0.0), RED)
    for k in range(60):
        size = (0.0402 + 0.0004 * (k % 2), 0.0602, 0.0502)
        known.take(seen(Block("box", 0.3, 0.1, 0.1 - 0.5 * math.pi, size, 0.0), RED))
    assert known.block.size == pytest.approx((0.0602, 0.0404, 0.0502), abs=1.5e-4)
    assert math.remainder(known.block.yaw - 0.1, math.pi) == pytest.approx(0.0, abs=1e-9)
    assert known.sigma == pytest.approx([0.001] * 3)  # frames share their errors


class Finder:
    """The objects of a memory of its own, before a camera."""

    def __init__(self, scene: BlockScene, memory: Memory) -> None:
        self.scene, self.memory, self.stamp = scene, memory, memory.clock.now()
        self.config = SceneEstimatorConfig(blocks=True)
        self.objects = UntaggedObjects(memory, self.config, logging.getLogger("test"))

    def look(self, frames: int = 1, seen: list[KnownVolume] | None = None) -> dict[str, Pose]:
        found: list[tuple[str, Pose]] = []
        for _ in range(frames):
            self.stamp += 0.1
            self.objects.update()
            view, color, _ = self.scene.look(CAMERA)
            blocks = self.objects.read(view, color, self.stamp, self.stamp, seen or [])
            found = [(name, CAMERA @ pose) for name, pose in self.objects.consider("camera", blocks, self.stamp)]
            for name, pose in found:
                self.memory.add_edge("world", name, "RT", pose=pose)
        return dict(found)


@pytest.fixture
def finder(scene: BlockScene, memory: Memory) -> Iterator[Finder]:
    found = Finder(scene, memory)
    yield found
    found.objects.close()


def test_what_is_seen_steadily_becomes_a_node_with_its_extents(scene: BlockScene, finder: Finder) -> None:
    scene.stand("red", 0.3, 0.1)
    scene.stand("can", 0.3, -0.1)
    finder.look(finder.config.blocks_after)
    assert finder.memory.nodes("box") == []
    finder.look(2)
    box, can = finder.memory.node("box_1"), finder.memory.node("cylinder_1")
    assert sorted(box["size"]) == pytest.approx(sorted(BOX), abs=0.003)
    assert max(box["size_sigma"]) < 0.005
    assert (box["source"], "shape" in box) == ("depth", False)
    assert from_numbers(can["shape"])[0].kind == "cylinder"


def test_names_outlive_moves_absence_and_a_restart(scene: BlockScene, finder: Finder) -> None:
    scene.stand("red", 0.3, 0.1)
    scene.stand("blue", 0.3, -0.1)
    places = finder.look(finder.config.blocks_after + 2)
    names = {"red" if pose.t[1] > 0.0 else "blue": name for name, pose in places.items()}
    assert sorted(names.values()) == ["box_1", "box_2"]
    finder.objects.close()
    finder.objects = UntaggedObjects(finder.memory, finder.config, logging.getLogger("test"))
    scene.put("blue", AWAY)
    assert finder.look().keys() == {names["red"]}
    scene.stand("red", 0.4, -0.1)
    scene.stand("blue", 0.3, 0.15)
    places = finder.look()
    assert places[names["red"]].t == pytest.approx((0.4, -0.1, 0.025), abs=0.005)
    assert places[names["blue"]].t == pytest.approx((0.3, 0.15, 0.025), abs=0.005)


def test_a_block_that_is_put_on_another_one_keeps_its_name(scene: BlockScene, finder: Finder) -> None:
    scene.stand("red", 0.3, 0.1)
    scene.stand("blue", 0.3, -0.1)
    places = finder.look(finder.config.blocks_after + 2)
    red = next(name for name, pose in places.items() if pose.t[1] > 0.0)
    truth = scene.stand("red", 0.3, -0.1, base=BOX[2])
    places = finder.look(finder.config.blocks_after + 2)
    assert places[red].t == pytest.approx(truth.centre, abs=0.005)
    assert len(finder.memory.nodes("box")) == 2


def test_two_of_one_colour_that_are_moved_until_they_touch_stay_two(scene: BlockScene, finder: Finder) -> None:
    left = scene.stand("blue", 0.33, 0.06)
    scene.stand("other_blue", 0.33, -0.06)
    places = finder.look(finder.config.blocks_after + 2)
    names = sorted(places, key=lambda name: -places[name].t[1])
    for y in np.linspace(0.05, 0.0202, 4).tolist():
        left, right = scene.stand("blue", 0.33, y), scene.stand("other_blue", 0.33, -y)
        places = finder.look()
    places = finder.look(finder.config.blocks_after + 2)
    for name, truth in zip(names, (left, right), strict=True):
        assert places[name].t == pytest.approx(truth.centre, abs=0.005)
    assert len(finder.memory.nodes("box")) == 2


def test_known_things_are_no_blocks(scene: BlockScene, finder: Finder) -> None:
    truth = scene.stand("red", 0.3, 0.1)
    tagged = KnownVolume.box(CAMERA.inverse() @ Pose(truth.centre), BOX)
    finder.look(finder.config.blocks_after + 2, [tagged])
    assert finder.memory.nodes("box") == []
    finder.memory.add_node("cube_7", "cube", size=BOX, marker_id=7)
    finder.memory.add_edge("world", "cube_7", "RT", pose=Pose(truth.centre))
    finder.look(finder.config.blocks_after + 2)
    assert finder.memory.nodes("box") == []


def test_a_removed_node_is_forgotten_and_found_anew(scene: BlockScene, finder: Finder) -> None:
    scene.stand("red", 0.3, 0.1)
    finder.look(finder.config.blocks_after + 2)
    finder.memory.remove_node("box_1")
    assert finder.look() == {}
    finder.look(finder.config.blocks_after + 1)
    assert [node.name for node in finder.memory.nodes("box")] == ["box_1"]


def test_the_agent_writes_percepts_of_blocks_only_if_it_is_asked_to(
    scene: BlockScene, make_bench: Callable[..., Bench]
) -> None:
    truth = scene.stand("red", 0.3, 0.1, 0.3)
    frame = scene.frame(CAMERA)
    for blocks in (False, True):
        bench = make_bench(blocks=blocks, cameras=["camera_fixed"])
        bench.add_camera("camera_fixed", CAMERA)
        bench.memory.add_node("table", "table", size=TableSpec().size)
        bench.memory.add_edge("world", "table", "RT", pose=Pose(TableSpec().position))
        bench.show(frame, "camera_fixed", ticks=bench.agent.config.blocks_after + 4)
        assert bench.perceived("box_1") is (True if blocks else None)
    percept = bench.memory.edge("camera_fixed", "box_1", "RT").pose
    error = (CAMERA @ percept).translation - truth.centre
    assert np.linalg.norm(error) < 0.005
    assert percept.covariance is not None
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived("box_1") is False
