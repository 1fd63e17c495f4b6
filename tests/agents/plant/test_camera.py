"""The simulated cameras: what they show, and what covers or moves them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from agents.plant.camera import OVERHEAD
from agents.plant.reality import Reality
from agents.plant.renderer import Renderer, opengl_works
from agents.scenario.format.scenario import ObjectSpec, SensorSpec
from dsr.math3d.transforms import Pose

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]

QUIET = SensorSpec(grey_noise=0.0)
DETECTOR = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
HAS_OPENGL = pytest.mark.skipif(not opengl_works(), reason="OpenGL does not work here")
RENDERERS = ["tiny", pytest.param("opengl", marks=HAS_OPENGL)]


def images(renderer: str, **config: Any) -> dict[str, Any]:
    return {"sensor": "pixels", "renderer": renderer, **config}


def tag_corners(reality: Reality, name: str) -> NDArray[np.float64]:
    """Pixels (4, 2) where the corners of the tag must be."""
    h = 0.016
    tag = [[-h, h, 0.02], [h, h, 0.02], [h, -h, 0.02], [-h, -h, 0.02]]
    camera = reality.camera
    return camera.intrinsics.project((camera.pose.inverse() @ reality.world.pose(name)).apply(tag))


def top_depth(reality: Reality, depth: NDArray[np.float32], name: str) -> tuple[float, float]:
    """Median depth measured on the upper face of a cube, and the true one, m."""
    low, high = tag_corners(reality, name).min(axis=0).astype(int), tag_corners(reality, name).max(axis=0).astype(int)
    true = (reality.camera.pose.inverse() @ reality.world.pose(name)).apply([0.0, 0.0, 0.02])[2]
    return float(np.median(depth[low[1] : high[1], low[0] : high[0]])), float(true)


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("camera", ["overhead", "wrist"])
def test_tags_are_seen_where_the_truth_projects(
    renderer: str, camera: str, make_reality: MakeReality, cube: MakeCube
) -> None:
    cubes = [
        cube(3, 0.42, 0.08, yaw=0.4),
        cube(4, 0.3, 0.1),
        cube(5, 0.3, -0.12, yaw=-1.0),
        cube(6, 0.45, -0.1, yaw=2.2),
    ]
    reality = make_reality(*cubes, config=images(renderer), camera=camera, sensor=QUIET)
    color = reality.frame(0.0).arrays["color"]
    corners, ids, _ = DETECTOR.detectMarkers(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY))
    assert sorted(ids.ravel().tolist()) == [3, 4, 5, 6]
    errors = np.array([c[0] - tag_corners(reality, f"cube_{i}") for c, i in zip(corners, ids.ravel(), strict=True)])
    assert np.linalg.norm(errors.mean(axis=(0, 1))) < 0.5
    assert np.linalg.norm(errors, axis=-1).mean() < 1.0


@pytest.mark.parametrize("renderer", RENDERERS)
def test_depth_is_true_in_metres(renderer: str, make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.40, 0.05), config=images(renderer), sensor=QUIET)
    depth = reality.frame(0.0).arrays["depth"]
    measured, true = top_depth(reality, depth, "cube_3")
    assert true == pytest.approx(0.61, abs=1e-3)
    assert measured == pytest.approx(true, abs=0.001)
    assert np.median(depth[:20]) == pytest.approx(0.65, abs=0.001)


def test_bias_brings_objects_nearer_but_not_the_table(make_reality: MakeReality, cube: MakeCube) -> None:
    biased = SensorSpec(depth_bias=(0.010, 0.012))
    reality = make_reality(cube(3, 0.35, 0.0), config=images("tiny", width=320, height=240), sensor=biased)
    depth = reality.frame(0.0).arrays["depth"]
    measured, true = top_depth(reality, depth, "cube_3")
    assert 0.009 < true - measured < 0.013
    assert np.median(depth[:20]) == pytest.approx(0.65, abs=0.002)


def test_jitter_is_common_to_an_object_and_new_in_each_frame(make_reality: MakeReality, cube: MakeCube) -> None:
    jittery = SensorSpec(depth_jitter=0.02)
    reality = make_reality(cube(3, 0.35, 0.0), config=images("tiny", width=320, height=240), sensor=jittery)
    heights = [top_depth(reality, reality.frame(0.0).arrays["depth"], "cube_3")[0] for _ in range(8)]
    assert 0.005 < np.std(heights) < 0.05


def test_frame_tells_stamp_and_intrinsics(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.4, 0.0), config=images("tiny", width=64, height=48, fov=1.0))
    frame = reality.frame(12.5)
    assert frame.stamp == 12.5
    assert frame.arrays["color"].shape == (48, 64, 3) and frame.arrays["color"].dtype == np.uint8
    assert frame.arrays["depth"].shape == (48, 64) and frame.arrays["depth"].dtype == np.float32
    assert frame.meta["cx"] == 31.5 and frame.meta["cy"] == 23.5
    assert frame.meta["fx"] == frame.meta["fy"] == pytest.approx(32 / np.tan(0.5))


def test_covered_lens_sees_nothing(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.4, 0.0), config=images("tiny", width=64, height=48))
    reality.camera.covers += 1
    frame = reality.frame(0.0)
    assert not frame.arrays["color"].any() and not frame.arrays["depth"].any()


def test_what_stands_still_before_two_cameras_is_drawn_once_for_each(
    monkeypatch: pytest.MonkeyPatch, make_reality: MakeReality, cube: MakeCube
) -> None:
    drawn: list[Pose] = []
    draw = Renderer._draw
    monkeypatch.setattr(Renderer, "_draw", lambda self, *of: (drawn.append(of[0]), draw(self, *of))[1])
    cameras = ("overhead", "wrist")
    reality = make_reality(cube(3, 0.4, 0.0), config=images("tiny", width=64, height=48, more_cameras=cameras))
    assert {camera.name for camera in reality.delivering} == set(cameras)
    for _ in range(3):
        frames = [reality.expose(1.0, camera)() for camera in reality.delivering]
    assert drawn == [camera.pose for camera in reality.delivering]
    assert np.any(frames[0].arrays["depth"] != frames[1].arrays["depth"])
    reality.delivering[1].bump(Pose((0.0, 0.0, 0.01)))
    for camera in reality.delivering:
        reality.expose(2.0, camera)
    assert len(drawn) == 3


def test_bumps_add_up_in_the_optical_frame(make_reality: MakeReality) -> None:
    camera = make_reality().camera
    assert camera.pose == OVERHEAD
    camera.bump(Pose.from_rotvec((0.0, 0.0, 0.1), (0.0, 0.0, 0.5)))
    camera.bump(Pose((0.0, 0.0, 0.1)))
    assert camera.pose.t == pytest.approx((0.35, 0.0, 0.45))
    assert camera.pose.distance(OVERHEAD)[1] == pytest.approx(0.5)


@HAS_OPENGL
def test_plants_of_one_process_draw_beside_each_other(make_reality: MakeReality, cube: MakeCube) -> None:
    first, second = (make_reality(cube(3, x, 0.0), config=images("auto"), sensor=QUIET) for x in (0.3, 0.4))
    seen = [reality.frame(0.0).arrays["color"].copy() for reality in (first, second, first)]
    assert [one._renderer.name for one in (first, second) if one._renderer is not None] == ["opengl", "opengl"]
    assert np.array_equal(seen[0], seen[2]) and np.any(seen[0] != seen[1])
    first.close()
    assert np.array_equal(second.frame(0.0).arrays["color"], seen[1])


def test_without_opengl_it_renders_in_software(
    monkeypatch: pytest.MonkeyPatch, make_reality: MakeReality, caplog: pytest.LogCaptureFixture
) -> None:
    def fails(**_: object) -> None:
        raise Exception("no display")

    monkeypatch.setattr("moderngl.create_context", fails)
    assert not opengl_works()
    reality = make_reality(config=images("auto", width=64, height=48))
    assert isinstance(reality._renderer, Renderer) and reality._renderer.name == "tiny"
    assert "rendering in software, several times slower: no OpenGL 3.3 without a window: no display" in caplog.text
    assert reality.frame(0.0).arrays["color"].any()
