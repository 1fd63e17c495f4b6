"""How a shape of known rotation is laid on the points that show it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.frame_images import images
from agents.scenario.format.scenario import ObjectSpec
from agents.scene_estimator.fitting import BEFORE, FrameView, ImagePart, fit, judged, settled
from agents.scene_estimator.placing import best_yaw
from agents.scene_estimator.segmentation import ColorImage
from benchmarks.color_scene import ColorScene, looking_at
from dsr import Pose
from dsr.math3d import transforms
from dsr.math3d.quaternions import Vector3
from dsr.perception.noise import PerceptNoise
from dsr.vocabulary.intrinsics import Intrinsics

PLACE = (0.35, 0.02)


def seen(
    scene: ColorScene, camera: Pose, model: str, hidden: float = 0.0, unknown: float = 0.0
) -> ImagePart:
    """What is seen of a model, but for the share `hidden` of its image's rows, the lowest ones.

    `unknown` stands for a depth that the camera could not measure.
    """
    color, depth, intrinsics = images(scene.frame(camera))
    assert depth is not None
    depth[depth == 0.0] = unknown
    (known,) = (one for one in scene.known if one.name == model)
    mask = ColorImage(color).mask(known.color)
    rows = np.flatnonzero(mask.any(axis=1))
    first = rows[int((1.0 - hidden) * (len(rows) - 1))] + 1 if hidden else len(mask)
    mask[first:] = False
    depth[first:] = 0.3  # something near
    view = FrameView(depth, intrinsics, camera)
    return ImagePart(view, mask)


@pytest.mark.parametrize("noise", range(3))
@pytest.mark.parametrize("hidden", [0.0, 0.55])
@pytest.mark.parametrize("model", ["container_green", "cup"])
def test_what_lies_nearly_right_is_moved_onto_the_points(model: str, hidden: float, noise: int) -> None:
    rng = np.random.default_rng(noise)
    scene = ColorScene([model], rng, [])
    try:
        truth = Pose((*PLACE, scene.height(model)))
        scene.put(model, truth)
        points = seen(scene, looking_at((*PLACE, 0.05), 1.0, rng), model, hidden)
        (known,) = scene.known
        for off in rng.uniform(-0.012, 0.012, (6, 3)):
            begin = judged(points, known.shape, known.size, truth.rotation_matrix, truth.translation + off)
            found = settled(points, known.shape, known.size, begin)
            error = found.position - truth.translation
            assert found.misfit <= begin.misfit
            assert np.linalg.norm(error[:2]) < 0.007, "one side of a thin wall is like the other"
            assert abs(error[2]) < abs(off[2]) + PerceptNoise().depth_noise, "walls tell little of their height"
    finally:
        scene.close()


@pytest.mark.parametrize("unknown", [0.0, np.inf, np.nan])
def test_edges_without_depth_do_not_pull_the_place_to_one_side(unknown: float) -> None:
    """Depth is missing where something far is behind: around the upper edges of a box, and not where it stands."""
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = ColorScene(["large_box"], rng, [])
        try:
            truth = Pose((*PLACE, scene.height("large_box")))
            scene.put("large_box", truth)
            camera = looking_at((*PLACE, 0.05), 1.0, rng)
            points = seen(scene, camera, "large_box", unknown=unknown)
            (known,) = scene.known
            found = fit(points, known.shape, known.size, truth.rotation_matrix)
            assert found is not None
            errors.append(camera.rotation_matrix.T @ (found.position - truth.translation))
        finally:
            scene.close()
    assert abs(np.mean(errors, axis=0)[1]) < 0.0005, "up and down in the image"


@pytest.mark.parametrize("model", ["large_box", "container_green", "cup"])
def test_a_shape_is_put_where_its_image_is_to_a_fraction_of_a_pixel(model: str) -> None:
    """A pixel is 1.6 mm wide there."""
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = ColorScene([model], rng, [])
        try:
            truth = Pose((*PLACE, scene.height(model)))
            scene.put(model, truth)
            camera = looking_at((*PLACE, 0.05), 1.0, rng)
            (known,) = scene.known
            found = fit(seen(scene, camera, model), known.shape, known.size, truth.rotation_matrix)
            assert found is not None
            errors.append(camera.rotation_matrix.T @ (found.position - truth.translation))
        finally:
            scene.close()
    across = np.sqrt(np.mean(np.square(errors), axis=0))[:2]
    assert across.max() < 0.0004


def test_an_edge_along_the_columns_of_pixels_is_rounded_alike_in_what_should_be_seen() -> None:
    """It is drawn up to half a pixel off, which is 0.8 mm there, and in all of its rows alike."""
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = ColorScene(["box"], rng, [])
        try:
            camera = looking_at((*PLACE, 0.05), 1.0, rng)
            x, y, _ = camera.rotation_matrix[:, 0].tolist()
            truth = Pose.from_rotvec((*PLACE, scene.height("box")), (0.0, 0.0, math.atan2(y, x)))
            scene.put("box", truth)
            (known,) = scene.known
            found = fit(seen(scene, camera, "box"), known.shape, known.size, truth.rotation_matrix)
            assert found is not None
            errors.append(camera.rotation_matrix.T @ (found.position - truth.translation))
        finally:
            scene.close()
    assert np.sqrt(np.mean(np.square(errors), axis=0))[0] < 0.0001, "sideways in the image"


def test_the_outline_of_a_box_tells_its_yaw_where_the_depth_is_noisy() -> None:
    errors = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        scene = ColorScene(["box"], rng, [])
        try:
            camera, yaw = looking_at((*PLACE, 0.05), 1.0, rng), float(rng.uniform(-0.7, 0.7))
            scene.put("box", Pose.from_rotvec((*PLACE, scene.height("box")), (0.0, 0.0, yaw)))
            (known,) = scene.known
            color, depth, intrinsics = images(scene.frame(camera))
            assert depth is not None
            depth[depth > 0.0] += rng.normal(0.0, 0.012, depth[depth > 0.0].shape).astype(np.float32)
            part = ImagePart(FrameView(depth, intrinsics, camera), ColorImage(color).mask(known.color))
            placed = best_yaw(part, known.shape, known.size, 0.0)
            errors.append(math.remainder(placed - yaw, math.pi))
        finally:
            scene.close()
    assert np.sqrt(np.mean(np.square(errors))) < math.radians(2.5)


@pytest.mark.parametrize(("beyond", "is_free"), [(2.0, True), (0.3, False)])
def test_pixels_without_depth_hide_something_only_beside_what_is_near(beyond: float, is_free: bool) -> None:
    """Around an edge, both what is before it and what is behind it are without depth."""
    intrinsics = Intrinsics(50.0, 50.0, 39.5, 29.5, 80, 60)
    depth, mask = np.full((60, 80), beyond, np.float32), np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    depth[mask], depth[:, 50] = 1.0, 0.0
    depth[:, 51:] = beyond
    part = ImagePart(FrameView(depth, intrinsics, Pose.identity()), mask)
    position = np.array([0.0, 0.0, 1.01])
    plate = part.shown((), (0.46, 0.36, 0.02), np.eye(3), position)
    at_edge = np.rint(intrinsics.project(plate.directions))[:, 0] == 50
    assert at_edge.any() and (part.expected(plate, position).free[at_edge] == is_free).all()


@pytest.mark.parametrize("beneath", ["table", "plate"])
def test_what_stands_on_a_thing_and_what_carries_it_do_not_shift_it(beneath: str) -> None:
    """Where two things touch, both are equally far: the upper one hides the lower one, which hides nothing of it."""
    plate, cube = spec_of("plate", (0.14, 0.14, 0.03), (0.1, 0.6, 0.7)), spec_of("cube", (0.04,) * 3, (0.3, 0.7, 0.1))
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = ColorScene(["box"], rng, [plate, cube])
        try:
            base = 0.0 if beneath == "table" else plate.size[2]
            truth = Pose((*PLACE, base + scene.height("box")))
            scene.put("box", truth)
            scene.put("cube", Pose((*PLACE, base + 2.0 * scene.height("box") + scene.height("cube"))))
            if base:
                scene.put("plate", Pose((*PLACE, scene.height("plate"))))
            (known,) = scene.known
            found = fit(seen(scene, looking_at((*PLACE, 0.05), 1.0, rng), "box"), (), known.size, np.eye(3))
            assert found is not None
            errors.append(found.position - truth.translation)
        finally:
            scene.close()
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 0.0006


def test_what_overhangs_a_thing_that_it_stands_on_does_not_press_it_down() -> None:
    """Along its lower edge it is as far as what it hides, but for noise, and some pixels have no depth."""
    roof, errors = spec_of("roof", (0.09, 0.07, 0.04), (0.1, 0.6, 0.7)), []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        scene = ColorScene(["box"], rng, [roof])
        try:
            truth = Pose((*PLACE, scene.height("box")))
            scene.put("box", truth)
            scene.put("roof", Pose((*PLACE, 2.0 * scene.height("box") + scene.height("roof"))))
            (known,) = scene.known
            camera = low(rng)
            color, depth, intrinsics = images(scene.frame(camera))
            assert depth is not None
            depth[depth > 0.0] += rng.normal(0.0, 0.004, depth[depth > 0.0].shape).astype(np.float32)
            part = ImagePart(FrameView(depth, intrinsics, camera), ColorImage(color).mask(known.color))
            found = fit(part, (), known.size, np.eye(3))
            assert found is not None
            errors.append(camera.rotation_matrix.T @ (found.position - truth.translation))
        finally:
            scene.close()
    assert abs(np.mean(errors, axis=0)[1]) < 0.0002, "up and down in the image"


def low(rng: np.random.Generator) -> Pose:
    """A camera that sees the sides of what is at `PLACE`, 1 m away."""
    azimuth = rng.uniform(0.0, 2.0 * math.pi)
    eye = (PLACE[0] + 0.9 * math.cos(azimuth), PLACE[1] + 0.9 * math.sin(azimuth), 0.65)
    return transforms.looking_at(eye, (*PLACE, 0.05))


def spec_of(name: str, size: Vector3, color: Vector3) -> ObjectSpec:
    return ObjectSpec(name=name, type="box", size=size, color=color, position=(0.0, 0.0, -9.0))


def test_where_it_is_looked_for_first_does_not_matter_for_what_is_seen_well() -> None:
    rng = np.random.default_rng(1)
    scene = ColorScene(["container_green"], rng, [])
    try:
        truth = Pose((*PLACE, scene.height("container_green")))
        scene.put("container_green", truth)
        points = seen(scene, looking_at((*PLACE, 0.05), 1.0, rng), "container_green")
        (known,) = scene.known
        one = fit(points, known.shape, known.size, truth.rotation_matrix)
        other = fit(points, known.shape, known.size, truth.rotation_matrix, start=BEFORE)
        assert one is not None and other is not None
        assert np.linalg.norm(one.position - other.position) < 0.001
    finally:
        scene.close()
