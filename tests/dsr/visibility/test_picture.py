"""Pictures: the same as casting every ray, in random scenes; what hides what; what is beyond the edges."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmarks.visibility_scene import LENS, TABLE, cast, random_things
from dsr.math3d.shapes import Part, box
from dsr.math3d.surfaces import Solids
from dsr.math3d.transforms import Array, Pose, looking_at
from dsr.visibility import Body, Picture, placed
from dsr.visibility.picture import NEAREST

CUBE = box((0.04, 0.04, 0.04))
VIEW = looking_at((-1.0, 0.0, 0.3), (0.0, 0.0, 0.02))


@pytest.mark.parametrize("seed", range(8))
def test_a_picture_is_that_of_casting_every_ray(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bodies = [TABLE, *random_things(rng, 10)]
    angle = rng.uniform(0.0, 2 * np.pi)
    view = looking_at((0.9 * np.cos(angle), 0.9 * np.sin(angle), 0.4), (0.2, 0.0, 0.0))
    picture = Picture(view, LENS, bodies, [body.name for body in bodies[1:]])
    expected = cast(view, LENS, bodies)
    for body in bodies[1:]:
        visible = picture.visible(body.name)
        assert (visible.pixels, visible.alone) == expected[body.name], body.name


def test_what_is_alone_is_seen_completely() -> None:
    picture = Picture(VIEW, LENS, [TABLE, placed("cube", CUBE, Pose((0.0, 0.0, 0.02)))], ["cube"])
    visible = picture.visible("cube")
    assert visible.share == 1.0 and visible.pixels == visible.alone > 5 and visible.hidden_by == ""


def test_what_stands_behind_a_larger_thing_is_hidden_by_it() -> None:
    wall = placed("wall", box((0.02, 0.3, 0.3)), Pose((-0.2, 0.0, 0.15)))
    picture = Picture(VIEW, LENS, [placed("cube", CUBE, Pose((0.0, 0.0, 0.02))), wall], ["cube", "wall"])
    assert picture.visible("cube").share == 0.0 and picture.visible("cube").hidden_by == "wall"
    assert picture.visible("wall").share == 1.0


def test_a_window_in_a_frame_hides_nothing() -> None:
    frame = (
        Part("box", (0.01, 0.05, 0.3), (0.0, -0.1, 0.0)), Part("box", (0.01, 0.05, 0.3), (0.0, 0.1, 0.0)),
        Part("box", (0.01, 0.25, 0.05), (0.0, 0.0, 0.15)),
    )  # fmt: skip
    window = placed("window", frame, Pose((-0.2, 0.0, 0.1)))
    picture = Picture(VIEW, LENS, [placed("cube", CUBE, Pose((0.0, 0.0, 0.02))), window], ["cube"])
    assert picture.visible("cube").share == 1.0


def test_what_the_edge_cuts_counts_as_seen_in_part() -> None:
    edge = 0.5 * LENS.width / LENS.fx  # m to the right, at 1 m
    body = placed("ball", (Part("sphere", (0.1, 0.1, 0.1)),), VIEW @ Pose((edge, 0.0, 1.0)))
    assert Picture(VIEW, LENS, [body], ["ball"]).visible("ball").share == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("place", [(0.0, 0.0, -1.0), (5.0, 0.0, 1.0)], ids=["behind", "beside"])
def test_what_is_not_before_the_eye_is_not_seen(place: tuple[float, float, float]) -> None:
    body = placed("cube", CUBE, VIEW @ Pose(place))
    assert Picture(VIEW, LENS, [body], ["cube"]).visible("cube")[:2] == (0.0, 0)


def test_what_is_around_the_eye_hides_nothing_from_it() -> None:
    housing = placed("housing", box((0.1, 0.1, 0.1)), VIEW)
    picture = Picture(VIEW, LENS, [housing, placed("cube", CUBE, Pose((0.0, 0.0, 0.02)))], ["cube"])
    assert picture.visible("cube").share == 1.0


def test_a_mesh_of_a_box_looks_like_the_box() -> None:
    pose = Pose.from_rotvec((0.0, 0.0, 0.02), (0.1, 0.2, 0.7))
    cube = placed("cube", CUBE, pose)
    corners = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.02, 0.02)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    indices = np.array([corner for a, b, c, d in sides for corner in ((a, b, c), (a, c, d))])
    nothing = type(cube.solids)(*(values[:0] for values in cube.solids))
    mesh = Body("mesh", nothing, pose.apply(corners)[indices])
    one, other = (Picture(VIEW, LENS, [TABLE, body], [body.name]) for body in (cube, mesh))
    assert other.visible("mesh")[:3] == one.visible("cube")[:3]
    assert np.allclose(one.inverse_depth, other.inverse_depth)


def hits(triangles: Array) -> Array:
    """(h, w) 1 / depth of the nearest triangle along each ray, by the crossing of each ray with each plane."""
    u, v = np.meshgrid(np.arange(LENS.width), np.arange(LENS.height))
    rays = np.stack([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones(u.shape)], axis=-1)
    found = np.zeros(u.shape)
    for a, b, c in triangles:
        first, second = b - a, c - a
        normal = np.cross(first, second)
        depth = (a @ normal) / (rays @ normal)
        points = rays * depth[..., None] - a
        along, across = np.cross(points, second) @ normal, np.cross(first, points) @ normal
        inside = (along >= 0.0) & (across >= 0.0) & (along + across <= normal @ normal) & (depth > NEAREST)
        found = np.maximum(found, np.where(inside, 1.0 / depth, 0.0))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_triangles_that_pass_the_eye_are_those_of_casting_every_ray(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(5, 3, 3)) * rng.choice([0.002, 0.3, 10.0])
    picture = Picture(Pose(), LENS, [Body("mesh", Solids.of(()), triangles)], [])
    assert np.allclose(picture.inverse_depth, hits(triangles), rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_the_walls_around_the_eye_hide_what_is_behind_them_however_they_are_divided(seed: int) -> None:
    room = trimesh.creation.box((8.0, 3.0, 3.0))
    view = looking_at((0.0, 0.0, 0.0), tuple(np.random.default_rng(seed).uniform((2.0, 1.0, -0.5), (3.0, 2.0, 0.5))))
    cube = placed("cube", box((0.4, 0.4, 0.4)), Pose((3.0, 2.5, 0.0)))
    seen = []
    for walls in (room, room.subdivide_to_size(0.5)):
        body = Body("room", Solids.of(()), np.asarray(walls.triangles))
        picture = Picture(view, LENS, [body, cube], ["cube"])
        assert picture.visible("cube").share == 0.0 and picture.visible("cube").hidden_by == "room"
        seen.append(picture.inverse_depth)
    assert (seen[0] > 0.0).all() and np.allclose(*seen)


def test_what_would_be_seen_of_something_that_is_not_there() -> None:
    wall = placed("wall", box((0.02, 0.3, 0.3)), Pose((-0.2, 0.0, 0.15)))
    empty, hidden = (Picture(VIEW, LENS, bodies, []) for bodies in ([TABLE], [TABLE, wall]))
    ghost = placed("ghost", CUBE, Pose((0.0, 0.0, 0.02)))
    assert empty.would_show(ghost).share == 1.0
    assert hidden.would_show(ghost) == (0.0, 0, empty.would_show(ghost).alone, "wall")
    assert empty.would_show(placed("ghost", CUBE, VIEW @ Pose((0.0, 0.0, -1.0)))) == (0.0, 0, 0, "")
