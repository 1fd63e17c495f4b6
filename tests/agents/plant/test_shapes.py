"""Containers, cups and balls in the true world: physics, pictures, and what the pose sensor tells of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from agents.object_models import find_model, load_model
from agents.plant.bullet import Bullet
from agents.plant.poses import SIGMA_TURN
from agents.plant.reality import Reality
from agents.plant.renderer import Renderer, RendererName
from agents.plant.world import RATE_HZ, World, upright
from agents.scenario.format.scenario import Carry, Lift, ObjectSpec, PlaceEvent, Slide, TableSpec, Tilt
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

MakeWorld = Callable[..., World]
MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
Play = Callable[..., None]


def made_of(model: str, x: float, y: float, z: float | None = None, **fields: Any) -> ObjectSpec:
    """An object called like its model that is known; on the table, unless `z` (m) is given."""
    given = {
        name: value for name, value in load_model(find_model(model, Path()))._asdict().items() if value is not None
    }
    height = given["size"][2] / 2 if z is None else z
    return ObjectSpec(**{"name": model, "model": model, "known": True, **given, "position": (x, y, height), **fields})


def below(world: World, seconds: float) -> None:
    for _ in range(round(seconds * RATE_HZ)):
        world.step()


@pytest.mark.parametrize("model", ["cup", "ball", "container_green", "cover_large", "lid", "large_box"])
def test_everything_stands_where_it_was_put(make_world: MakeWorld, model: str) -> None:
    spec = made_of(model, 0.3, 0.1)
    world = make_world(spec)
    world.settle()
    below(world, 2.0)
    assert world.pose(model).t == pytest.approx(spec.position, abs=5e-4)
    assert world.is_still(model)


def test_a_ball_falls_into_an_open_box_and_comes_to_rest_there(make_world: MakeWorld) -> None:
    world = make_world(made_of("container_green", 0.3, 0.0), made_of("ball", 0.32, 0.02, 0.3))
    world.settle()
    x, y, z = world.pose("ball").t
    assert z == pytest.approx(0.034, abs=1e-3)
    assert max(abs(x - 0.3), abs(y)) < 0.05
    assert world.supported("container_green") == ["ball"]
    assert world.supported("ball") == []
    assert world.body("container_green") in world.supports("ball")


def test_a_rolling_ball_comes_to_rest(make_world: MakeWorld) -> None:
    world = make_world(made_of("ball", 0.0, 0.0))
    world.settle()
    world.drive("ball", upright((0.0, 0.0, 0.03), 0.0), (0.3, 0.0, 0.0), (0.0, 10.0, 0.0))
    below(world, 4.0)
    assert world.is_still("ball")
    assert 0.02 < world.pose("ball").t[0] < 0.4


def test_what_is_under_a_cover_is_enclosed_but_not_carried(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(made_of("cover_large", 0.3, 0.0, marker_id=7), cube(3, 0.3, 0.0))
    world.settle()
    assert world.supported("cover_large") == ["cube_3"]
    assert world.supported("cover_large", enclosed=False) == []


def test_a_cover_that_is_slid_pushes_what_is_under_it_and_leaves_it_when_lifted(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    events = [Slide(at=0.0, object="cover_large", by=(0.1, 0.0)), Lift(at=2.0, object="cover_large", height=0.25)]
    cover = made_of("cover_large", 0.3, 0.0, marker_id=7)
    reality = make_reality(cover, cube(3, 0.3, 0.0), events=events)
    play(reality, 2.0)
    wall = 0.4 - 0.085 + 0.003
    assert reality.world.pose("cube_3").t == pytest.approx((wall + 0.02, 0.0, 0.02), abs=3e-3)
    play(reality, 2.0, start=2.0)
    assert reality.world.pose("cube_3").t[2] == pytest.approx(0.02, abs=1e-3)
    assert reality.world.pose("cover_large").t[2] == pytest.approx(0.075 + 0.25, abs=2e-3)


def test_a_ball_goes_with_the_box_and_can_be_poured(make_reality: MakeReality, play: Play) -> None:
    green, blue = made_of("container_green", 0.2, 0.2), made_of("container_blue", 0.5, -0.2)
    events = [
        Carry(at=0.0, object="container_green", to=(0.3, 0.04, 0.06)),
        Lift(at=4.0, object="container_green", height=0.2),
        PlaceEvent(at=5.9, object="container_blue", position=(0.3, -0.04, 0.06)),
        Tilt(at=6.0, object="container_green", angle=math.radians(135)),
    ]
    reality = make_reality(green, blue, made_of("ball", 0.2, 0.2, 0.034), events=events)
    play(reality, 4.0)
    assert reality.world.pose("container_green").t == pytest.approx((0.3, 0.04, 0.06), abs=2e-3)
    assert reality.world.supported("container_green") == ["ball"]
    play(reality, 6.0, start=4.0)
    assert reality.world.supported("container_blue") == ["ball"]


def test_an_object_that_was_removed_comes_back_with_its_shape(make_world: MakeWorld) -> None:
    world = make_world(made_of("container_green", 0.3, 0.0), made_of("ball", 0.3, 0.2))
    world.remove("container_green")
    world.put("container_green", upright((0.3, 0.0, 0.06), 0.0))
    world.put("ball", upright((0.3, 0.0, 0.2), 0.0))
    world.settle()
    assert world.pose("ball").t[2] == pytest.approx(0.034, abs=1e-3)


@pytest.mark.parametrize("renderer", ["auto", "tiny"])
def test_pictures_show_colours_hollows_and_tags(renderer: RendererName) -> None:
    bullet = Bullet()
    eye = Renderer(bullet, renderer)
    specs = [
        made_of("container_green", 0.3, 0.15),
        made_of("cover_large", 0.3, -0.15, marker_id=7),
        made_of("cup", 0.45, 0.0),
        made_of("ball", 0.15, 0.0),
    ]
    world = World(bullet, TableSpec(), specs)
    intrinsics = Intrinsics.from_fov(640, 480, 0.98)
    camera = Pose((0.3, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0))  # x right, y towards -y of the world
    picture = eye.render(camera, intrinsics, bodies=True)
    assert picture.bodies is not None

    def at(x: float, y: float, z: float) -> tuple[np.ndarray, float, int]:
        u, v = np.rint(intrinsics.project(camera.inverse().apply([[x, y, z]]))[0]).astype(int)
        assert picture.bodies is not None
        return picture.color[v, u].astype(float), float(picture.depth[v, u]), int(picture.bodies[v, u])

    for spec, height in ((specs[0], 0.004), (specs[2], 0.005), (specs[3], 0.06)):
        x, y, _ = spec.position
        color, depth, body = at(x, y, height)
        assert body == world.body(spec.name)
        assert depth == pytest.approx(0.8 - height, abs=1.5e-3)
        assert spec.color is not None
        assert color / np.linalg.norm(color) == pytest.approx(spec.color / np.linalg.norm(spec.color), abs=0.03)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    assert detector.detectMarkers(cv2.cvtColor(picture.color, cv2.COLOR_RGB2GRAY))[1].ravel().tolist() == [7]
    eye.close()
    bullet.close()


def seen_colors(reality: Reality) -> list[tuple[float, ...]]:
    return [reading.color for reading in reality.readings(0.0).colors]


def test_colours_are_read_where_the_objects_are(make_reality: MakeReality) -> None:
    reality = make_reality(made_of("cup", 0.35, 0.1))
    samples = [reality.readings(0.0).colors[0] for _ in range(200)]
    true = reality.camera.pose.inverse() @ reality.world.pose("cup")
    errors = np.array([sample.position for sample in samples]) - true.translation
    assert errors.mean(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    assert errors.std(axis=0) == pytest.approx(samples[0].sigma, rel=0.2)
    assert reality.truth(0.0).in_view == ("cup",)


def test_hollow_objects_show_how_they_are_turned(make_reality: MakeReality) -> None:
    box = made_of("container_green", 0.35, 0.1)
    reality = make_reality(box, made_of("ball", 0.3, -0.15))
    true = upright((0.35, 0.1, 0.06), 0.4)
    reality.world.put("container_green", true)
    camera_from_object = reality.camera.pose.inverse() @ true
    angles = []
    for _ in range(100):
        seen = {reading.color: reading for reading in reality.readings(0.0).colors}
        ahead = seen[box.color].ahead
        angles.append(math.asin(float(np.dot(ahead, camera_from_object.rotation_matrix[:, 1]))))
        assert all(reading.ahead is None for color, reading in seen.items() if color != box.color)
    assert np.mean(angles) == pytest.approx(0.0, abs=0.01)
    assert np.std(angles) == pytest.approx(SIGMA_TURN, rel=0.3)


def test_what_is_hidden_or_out_of_the_image_has_no_colour(make_reality: MakeReality) -> None:
    ball, box = made_of("ball", 0.3, 0.15, 0.034), made_of("container_green", 0.3, 0.15)
    reality = make_reality(ball, box, made_of("cup", 0.3, 0.6), made_of("lid", 0.3, -0.1))
    assert seen_colors(reality) == [ball.color, box.color, made_of("lid", 0, 0).color]
    reality.world.put("lid", upright((0.3, 0.15, 0.125), 0.0))
    assert seen_colors(reality) == [made_of("lid", 0, 0).color]
    reality.camera.covers += 1
    assert seen_colors(reality) == []


def test_what_nobody_knows_has_no_colour(make_reality: MakeReality) -> None:
    assert seen_colors(make_reality(made_of("cup", 0.35, 0.1, known=False))) == []
