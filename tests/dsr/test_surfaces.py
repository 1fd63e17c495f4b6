"""What of a body can be seen from a point, against pictures drawn by brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d import quaternions
from dsr.math3d.shapes import Part, Shape, box
from dsr.math3d.surfaces import (
    Solids,
    crossings,
    distances,
    room_below,
    seen_alone,
    signed_distances,
    surface,
    underside,
)
from dsr.math3d.transforms import Pose

HALF_TURN = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
OPEN_BOX: Shape = (
    Part("box", (0.2, 0.2, 0.01), (0.0, 0.0, -0.095)),
    *(Part("box", (0.2, 0.01, 0.19), (0.0, side * 0.095, 0.005)) for side in (1, -1)),
    *(Part("box", (0.01, 0.18, 0.19), (side * 0.095, 0.0, 0.005)) for side in (1, -1)),
)


@pytest.mark.parametrize(
    ("part", "area"),
    [
        (Part("box", (0.1, 0.2, 0.3)), 0.22),
        (Part("sphere", (0.1, 0.1, 0.1)), math.pi * 0.01),
        (Part("cylinder", (0.1, 0.1, 0.2)), math.pi * 0.1 * 0.25),
        (Part("cylinder", (0.1, 0.1, 0.2), (0.3, 0.0, 0.0), HALF_TURN), math.pi * 0.1 * 0.25),
    ],
)
def test_points_are_on_the_surface_and_stand_for_all_of_it(part: Part, area: float) -> None:
    points, normals, areas = surface((part,), (1.0, 1.0, 1.0))
    assert areas.sum() == pytest.approx(area)
    for point, normal in zip(points, normals, strict=True):
        assert part.contains(tuple(point - 1e-6 * normal))
        assert not part.contains(tuple(point + 1e-6 * normal))


def test_of_parts_that_overlap_only_the_outside_counts() -> None:
    halves = (Part("box", (0.2, 0.1, 0.1), (-0.05, 0.0, 0.0)), Part("box", (0.2, 0.1, 0.1), (0.05, 0.0, 0.0)))
    assert surface(halves, (0.3, 0.1, 0.1)).points[:, 0].min() == pytest.approx(-0.15)
    inside = np.abs(surface(halves, (0.3, 0.1, 0.1)).points[:, 0]) < 0.04
    assert (np.abs(surface(halves, (0.3, 0.1, 0.1)).points[inside, 1:]).max(axis=1) > 0.049).all()


def test_of_a_box_seen_from_above_only_the_top_is_seen() -> None:
    points, weights = seen_alone((), (0.1, 0.1, 0.1), np.array([0.0, 0.0, 1.0]))
    assert points[:, 2] == pytest.approx(0.05)
    assert weights.sum() == pytest.approx(1.0)


def test_an_open_box_shows_its_inside_from_above_and_hides_it_from_the_side() -> None:
    points, weights = seen_alone(OPEN_BOX, (0.2, 0.2, 0.2), np.array([0.0, 0.0, 1.0]))
    on_the_bottom = points[:, 2] < -0.08
    assert weights[on_the_bottom].sum() > 0.4
    points, _ = seen_alone(OPEN_BOX, (0.2, 0.2, 0.2), np.array([1.0, 0.0, 0.0]))
    assert points[:, 0] == pytest.approx(0.1)


@pytest.mark.parametrize("count", [600, 1500, 6000])
def test_what_faces_of_several_parts_have_in_common_counts_once(count: int) -> None:
    """A box, and a thin wall that overlaps with half of it: from above they look like the box alone."""
    size = (0.2, 0.2, 0.2)
    both: Shape = (Part("box", size), Part("box", (0.1, 0.2, 0.2), (0.05, 0.0, 0.0)))
    points, weights = seen_alone(both, size, np.array([0.0, 0.0, 1.0]), count)
    assert abs(weights @ points[:, 0]) < 0.002
    assert weights.sum() == pytest.approx(1.0)


def test_of_a_shape_of_several_parts_no_finer_points_are_kept_than_are_asked_for() -> None:
    """Those took a megabyte for each of 256 shapes, and who makes up things may make up shapes."""
    surface.cache_clear()
    both: Shape = (Part("box", (0.2, 0.2, 0.21)), Part("box", (0.1, 0.2, 0.21), (0.05, 0.0, 0.0)))
    points, _ = seen_alone(both, (0.2, 0.2, 0.21), np.array([0.0, 0.0, 1.0]), 600)
    assert len(points) > 0 and surface.cache_info().currsize == 1


@pytest.mark.parametrize("eye", [(0.4, 0.3, 0.5), (0.0, 0.0, -1.0), (-0.3, 0.05, 0.2)])
def test_weights_are_shares_of_the_image(eye: tuple[float, float, float]) -> None:
    """The share that lies in one half of the body, against rays through every pixel."""
    start = np.array(eye)
    points, weights = seen_alone(OPEN_BOX, (0.2, 0.2, 0.2), start)
    ahead = -start / np.linalg.norm(start)
    right = np.cross(ahead, (0.3, 0.7, 0.64))
    right /= np.linalg.norm(right)
    grid = np.linspace(-0.6, 0.6, 300)
    u, v = (axis.ravel()[:, None] for axis in np.meshgrid(grid, grid))
    way = ahead + u * right + v * np.cross(ahead, right)
    solids = Solids.of(OPEN_BOX)
    local = np.einsum("nj,nji->ni", start - solids.centre, solids.rotation)
    enters, leaves = crossings(solids.kinds, solids.half, local[:, None], way[None] @ solids.rotation)
    first = np.where(enters < leaves, enters, np.inf).min(axis=0)
    hit = np.isfinite(first)
    upper = (start + first[hit, None] * way[hit])[:, 2] > 0.0
    solid_angle = np.linalg.norm(way[hit], axis=1) ** -3
    assert weights[points[:, 2] > 0.0].sum() == pytest.approx(solid_angle[upper].sum() / solid_angle.sum(), abs=0.06)


def test_rays_against_round_parts() -> None:
    parts = (Part("sphere", (0.2, 0.2, 0.2)), Part("cylinder", (0.2, 0.2, 0.4), (1.0, 0.0, 0.0)), *box((0.1, 0.1, 0.1)))
    eye = np.array([0.0, 0.0, 2.0])
    targets = np.array([[0.0, 0.0, -1.0], [1.05, 0.05, -0.1], [0.5, 0.5, -1.0], [0.0, 0.0, 0.11]])
    expected = [[True, False, False, False], [False, True, False, False], [True, False, False, False]]
    assert Solids.of(parts).cut_off(eye, targets).tolist() == expected


def test_where_rays_meet_the_first_part() -> None:
    solids = Solids.of((Part("sphere", (0.2, 0.2, 0.2)), Part("box", (2.0, 2.0, 0.2), (0.0, 0.0, -0.9))))
    rays = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -2.0], [0.4, 0.0, -1.0], [0.0, 0.0, 1.0], [5.0, 0.0, -1.0]])
    met = solids.first_met(np.array([0.0, 0.0, 1.2]), rays).tolist()
    assert met == pytest.approx([1.1, 0.55, 2.0, math.inf, math.inf])


def test_distances_from_the_surface() -> None:
    size = (1.0, 1.0, 1.0)
    ball, cylinder = (Part("sphere", (0.2, 0.2, 0.2)),), (Part("cylinder", (0.2, 0.2, 0.4), (1.0, 0.0, 0.0)),)
    points = np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.04], [1.3, 0.0, 0.0], [1.0, 0.0, 0.5], [1.13, 0.0, 0.24]])
    assert distances(ball, size, points)[:2] == pytest.approx([0.2, 0.06])
    assert distances(cylinder, size, points)[2:] == pytest.approx([0.2, 0.3, 0.05])
    assert distances((), (0.2, 0.2, 0.2), points)[:2] == pytest.approx([0.2, 0.06])
    assert distances((*ball, *cylinder), size, points) == pytest.approx([0.2, 0.06, 0.2, 0.3, 0.05])


def test_distances_within_are_negative() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.095, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, -0.098]])
    assert signed_distances((), (0.2, 0.2, 0.2), points) == pytest.approx([-0.1, -0.005, 0.1, -0.002])
    assert signed_distances(OPEN_BOX, (0.2, 0.2, 0.2), points) == pytest.approx([0.09, -0.005, 0.1, -0.002])


def test_the_surface_is_no_distance_from_itself() -> None:
    assert distances(OPEN_BOX, (0.2, 0.2, 0.2), surface(OPEN_BOX, (0.2, 0.2, 0.2)).points) == pytest.approx(
        0.0, abs=1e-9
    )


def test_what_is_no_thing_has_no_surface() -> None:
    for size in ((1e-300, 1.0, 1.0), (1e200, 1.0, 1.0)):
        points, weights = seen_alone((), size, np.array([0.0, 0.0, 1.0]))
        assert len(points) == len(weights) == 0


def test_the_underside_looks_down_and_reaches_the_lowest_point() -> None:
    rng = np.random.default_rng(4)
    for kind in ("box", "cylinder", "sphere"):
        part = Part(kind, (0.1, 0.1, 0.1) if kind == "sphere" else (0.1, 0.1, 0.2))
        for _ in range(10):
            pose = Pose(
                tuple(rng.uniform(-1, 1, 3).tolist()), quaternions.normalised(tuple(rng.normal(size=4).tolist()))
            )
            points = underside((part,), (0.1, 0.1, 0.2), pose.matrix)
            down = -pose.matrix[2, :3]  # in the frame of the part
            if kind == "sphere":
                reach = 0.05
            elif kind == "box":
                reach = float(np.abs(down) @ (0.05, 0.05, 0.1))
            else:
                reach = 0.05 * float(np.hypot(down[0], down[1])) + 0.1 * abs(float(down[2]))
            assert points[:, 2].min() == pytest.approx(pose.t[2] - reach, abs=2e-4)
            assert np.abs(distances((part,), (0.1, 0.1, 0.2), pose.inverse().apply(points))).max() < 1e-9


def test_room_below_is_what_a_body_can_fall() -> None:
    floor = Solids.of((Part("box", (1.0, 1.0, 0.1), (0.0, 0.0, -0.05)),))
    points = underside((), (0.1, 0.1, 0.1), Pose((0.3, 0.0, 0.25), (0.0, 0.0, 0.0, 1.0)).matrix)
    assert room_below(points, floor) == pytest.approx(0.2)
    assert room_below(points + np.array((1.0, 0.0, 0.0)), floor) == math.inf
    assert room_below(points - (0.0, 0.0, 0.22), floor) == math.inf  # it is in the floor already


def test_solids_move_with_the_frame_they_are_given_in() -> None:
    rng = np.random.default_rng(5)
    pose = Pose((0.1, -0.2, 0.3), quaternions.normalised((0.1, 0.2, 0.3, 0.9)))
    points = rng.uniform(-0.2, 0.2, (50, 3))
    moved = Solids.of(OPEN_BOX).moved(pose.matrix).signed_distances(pose.apply(points))
    assert moved == pytest.approx(Solids.of(OPEN_BOX).signed_distances(points))
