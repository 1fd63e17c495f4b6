"""The tilt of a camera that was bumped is seen by the table, so that blocks are perceived as from where it is."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator

import numpy as np
import pytest

from agents.frame_images import images
from agents.scenario.format.scenario import ObjectSpec
from agents.scene_estimator.blocks import LevelledView, UntaggedObjects, levelled
from agents.scene_estimator.blocks.levelling import ANY_TILT
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.fitting import FrameView
from benchmarks.color_scene import AWAY, ColorScene
from dsr import Memory, Pose
from dsr.math3d import transforms

from .block_scene import TABLE

CUBES = {
    "red": ((0.85, 0.2, 0.15), (0.42, 0.08)), "blue": ((0.15, 0.3, 0.9), (0.3, 0.09)),
    "green": ((0.2, 0.7, 0.25), (0.31, -0.08)), "violet": ((0.6, 0.2, 0.7), (0.41, -0.07)),
}  # fmt: skip
TRUE = transforms.looking_at((0.1, 0.05, 0.7), (0.36, 0.0, 0.0))
BUMP = Pose.from_rotvec((0.02, -0.015, 0.01), (0.03, -0.04, 0.08))


@pytest.fixture(scope="module")
def scene() -> Iterator[ColorScene]:
    specs = [ObjectSpec(name=name, size=(0.04,) * 3, color=one[0], position=AWAY.t) for name, one in CUBES.items()]
    scene = ColorScene([], np.random.default_rng(0), specs)
    for number, (name, (_, (x, y))) in enumerate(CUBES.items()):
        scene.put(name, Pose.from_rotvec((x, y, 0.02), (0.0, 0.0, 0.2 * number)))
    yield scene
    scene.close()


def look(scene: ColorScene, believed: Pose) -> LevelledView:
    _, depth, intrinsics = images(scene.frame(TRUE))
    assert depth is not None
    return levelled(FrameView(depth, intrinsics, believed), [TABLE])


def tilt(one: Pose, other: Pose) -> float:
    """Angle between what is vertical for two cameras, rad."""
    return math.acos(min(1.0, float(one.rotation_matrix[2] @ other.rotation_matrix[2])))


@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0), (0.03, -0.04, 0.08), (-0.08, 0.0, 0.0), (0.0, 0.07, -0.1)])
def test_the_table_tells_the_tilt_of_a_camera_whatever_was_believed(
    scene: ColorScene, rotation: tuple[float, float, float]
) -> None:
    believed = TRUE @ Pose.from_rotvec((0.01, -0.01, 0.01), rotation)
    seen = look(scene, believed)
    assert tilt(seen.view.world_from_camera, TRUE) < 0.004
    assert 0.001 < seen.tilt_sigma < 0.02


def test_without_a_table_in_view_the_tilt_is_as_believed_and_unsure(scene: ColorScene) -> None:
    _, depth, intrinsics = images(scene.frame(TRUE))
    assert depth is not None
    view = FrameView(depth, intrinsics, TRUE)
    for unseen in (view._replace(depth=np.zeros_like(depth)), view._replace(world_from_camera=Pose((0.0, 0.0, 9.0)))):
        assert levelled(unseen, [TABLE]) == LevelledView(unseen, ANY_TILT)
    assert levelled(view, []) == LevelledView(view, ANY_TILT)


def test_blocks_are_perceived_from_where_a_bumped_camera_is(scene: ColorScene, memory: Memory) -> None:
    objects = UntaggedObjects(memory, SceneEstimatorConfig(blocks=True), logging.getLogger("test"))
    percepts: dict[str, Pose] = {}
    for frame in range(14):
        believed = TRUE @ BUMP.inverse() if frame > 10 else TRUE
        color, depth, intrinsics = images(scene.frame(TRUE))
        assert depth is not None
        stamp = 0.1 * (frame + 1)
        blocks = objects.read(FrameView(depth, intrinsics, believed), color, stamp, stamp, [])
        percepts = dict(objects.consider("camera", blocks, stamp))
    assert len(percepts) == len(CUBES)
    for percept in percepts.values():
        seen = TRUE @ percept
        assert min(math.dist(seen.t[:2], place) for _, place in CUBES.values()) < 0.003
        assert seen.t[2] == pytest.approx(0.02, abs=0.004)
        lean = math.acos(min(1.0, float(seen.rotation_matrix[2, 2])))
        assert percept.covariance is not None
        assert lean < 0.006 < math.sqrt(percept.covariance[3, 3]) < 0.06
    objects.close()
