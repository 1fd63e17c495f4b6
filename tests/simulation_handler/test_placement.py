"""A noisy pose becomes one that physics allows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsr.math3d.polygons import Polygon, are_apart, overlap
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.contact import placement
from simulation_handler.contact.placement import (
    Pairs,
    covariance_given_height,
    find_support,
    given_height,
    place,
    separate,
)
from simulation_handler.scales import GAP
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import BALL, CAMERA, CUBE, ROUND, WALL, container

CONFIG = BeliefConfig()
TABLE = Solid("table", (1.2, 1.2, 0.04), (0.35, 0.0, -0.02), fixed=True)


def covariance(position: Vector3, along: float = 0.01, across: float = 0.0005) -> np.ndarray:
    """Of a position seen from the camera: m^2."""
    ray = np.array(position) - CAMERA
    ray /= np.linalg.norm(ray)
    return across**2 * np.eye(3) + (along**2 - across**2) * np.outer(ray, ray)


def cube(name: str, x: float, y: float, z: float = 0.02, yaw: float = 0.0) -> Solid:
    return Solid(name, CUBE, (x, y, z), Pose.from_rotvec((0, 0, 0), (0, 0, yaw)).q)


def seen(truth: Solid, bias: float) -> Solid:
    """The solid with a depth error of `bias` m towards the camera."""
    ray = np.array(truth.position) - CAMERA
    x, y, z = (np.array(truth.position) - bias * ray / np.linalg.norm(ray)).tolist()
    return truth.moved((x, y, z))


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.015, 0.02), st.floats(-3.0, 3.0))
def test_a_depth_error_is_undone_along_the_viewing_ray(x: float, y: float, bias: float, yaw: float) -> None:
    truth = cube("c", 0.35 + x, y, yaw=yaw)
    percept = seen(truth, bias)
    placement = place(percept, covariance(percept.position), [TABLE], CONFIG)
    assert placement.supports == ("table",)
    assert placement.solid.position == pytest.approx(truth.position, abs=0.0003)
    assert placement.solid.position[2] == pytest.approx(0.02, abs=1e-9)


@pytest.mark.parametrize("error", [GAP, 0.002])
def test_a_place_is_known_across_the_ray_and_as_well_as_its_height(error: float) -> None:
    """An error of the height moves the place along the viewing ray."""
    truth, rng = np.array((0.5, 0.1, 0.02)), np.random.default_rng(0)
    told = covariance(tuple(truth.tolist()))
    percepts = rng.multivariate_normal(truth, told, 4000)
    heights = truth[2] + error * rng.normal(size=len(percepts))
    found = [given_height(tuple(one), told, height) for one, height in zip(percepts, heights, strict=True)]
    expected = np.cov(np.transpose(found))
    assert covariance_given_height(told, error) == pytest.approx(expected, abs=0.1 * float(np.linalg.norm(expected)))
    assert covariance_given_height(told, error)[2, 2] == pytest.approx(error**2)


def test_tilt_is_removed_and_yaw_kept() -> None:
    tilted = Pose.from_rotvec((0, 0, 0), (0.2, 0.1, 0.0)) @ Pose.from_rotvec((0, 0, 0), (0, 0, 0.7))
    percept = Solid("c", CUBE, (0.4, 0.1, 0.03), tilted.q)
    placement = place(percept, covariance(percept.position), [TABLE], CONFIG)
    upright = Pose.from_rotvec((0, 0, 0), (0, 0, 0.7))
    assert Pose(rotation=placement.solid.rotation).distance(upright)[1] < 1e-6
    assert placement.rests


def test_what_is_tilted_beyond_noise_is_not_carried_but_stays_above_the_table() -> None:
    percept = Solid("c", CUBE, (0.4, 0.1, 0.02), Pose.from_rotvec((0, 0, 0), (0.7, 0, 0)).q)
    placement = place(percept, covariance(percept.position), [TABLE], CONFIG)
    assert not placement.rests
    assert placement.solid.rotation == percept.rotation
    assert placement.solid.bottom == pytest.approx(0.0, abs=1e-9)


def test_what_hovers_beyond_the_edge_of_another_one_is_not_inside_that() -> None:
    below = cube("below", 0.4, 0.1)
    placement = place(cube("c", 0.43, 0.1, 0.057), covariance((0.43, 0.1, 0.057)), [TABLE, below], CONFIG)
    assert not placement.rests
    assert placement.solid.bottom == pytest.approx(below.top, abs=1e-9)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_it_rests_on_the_top_of_a_stack(level: int) -> None:
    stack = [cube(f"s{i}", 0.4, 0.1, 0.02 + 0.04 * i) for i in range(level)]
    percept = seen(cube("c", 0.405, 0.1, 0.02 + 0.04 * level), 0.015)
    placement = place(percept, covariance(percept.position), [TABLE, *stack], CONFIG)
    assert placement.supports == (f"s{level - 1}",)
    assert placement.solid.bottom == pytest.approx(0.04 * level, abs=1e-9)


def test_it_can_bridge_two_solids_but_not_rest_on_slivers() -> None:
    piers = [cube("left", 0.37, 0.1), cube("right", 0.43, 0.1)]
    bridge = Solid("c", (0.08, 0.04, 0.02), (0.4, 0.1, 0.05))
    assert find_support(bridge, bridge.bottom, [TABLE, *piers], 0.025)[0] == ("left", "right")
    between = cube("c", 0.4, 0.1, 0.042)
    walls = [cube("left", 0.362, 0.1), cube("right", 0.438, 0.1)]
    assert find_support(between, between.bottom, [TABLE, *walls], 0.025)[0] == ("table",)


@pytest.mark.parametrize(("offset", "support"), [(0.019, "s"), (0.021, "table")])
def test_the_centre_of_mass_must_be_above_the_support(offset: float, support: str) -> None:
    low = Solid("s", (0.04, 0.04, 0.01), (0.4, 0.1, 0.005))
    solid = cube("c", 0.4 + offset, 0.1, 0.025)
    assert find_support(solid, solid.bottom, [TABLE, low], 0.025)[0] == (support,)


@pytest.mark.parametrize(("hover", "rests"), [(0.024, True), (0.028, False), (-0.03, True)])
def test_reach(hover: float, rests: bool) -> None:
    percept = cube("c", 0.4, 0.1, 0.02 + hover)
    placement = place(percept, covariance(percept.position), [TABLE], CONFIG)
    assert placement.rests is rests
    assert placement.solid.position[2] == pytest.approx(0.02 if rests else 0.02 + hover)


def deepest(solids: list[Solid]) -> float:
    """The deepest sideways overlap, m."""
    return max(overlap(a.footprint, b.footprint)[0] for i, a in enumerate(solids) for b in solids[i + 1 :])


@given(st.lists(st.tuples(*[st.floats(-0.004, 0.004)] * 2, st.floats(-0.03, 0.03)), min_size=9, max_size=9))
@settings(max_examples=30, deadline=None)
def test_neighbours_in_a_tight_block_are_pushed_apart(noise: list[tuple[float, float, float]]) -> None:
    solids = [
        cube(f"c{i}", 0.042 * (i % 3) + dx, 0.042 * (i // 3) + dy, yaw=yaw) for i, (dx, dy, yaw) in enumerate(noise)
    ]
    pushed = separate(solids, {solid.name: 1.0 for solid in solids})
    after = [solid.moved(pushed.get(solid.name, solid.position)) for solid in solids]
    assert deepest(after) < 0.0001
    assert all(math.dist(a.position, b.position) < 0.02 for a, b in zip(solids, after, strict=True))


def test_who_is_less_certain_gives_draw() -> None:
    solids = [cube("sure", 0.0, 0.0), cube("vague", 0.038, 0.0)]
    pushed = separate(solids, {"sure": 1.0, "vague": 99.0})
    assert pushed["sure"][0] == pytest.approx(-0.00002, abs=1e-5)
    assert pushed["vague"][0] == pytest.approx(0.04003, abs=1e-5)
    assert "wall" not in separate([Solid("wall", CUBE, (0.0, 0.0, 0.02), fixed=True), solids[1]], {"vague": 1.0})


def test_a_stack_is_not_pushed_apart() -> None:
    assert separate([cube("a", 0.0, 0.0), cube("b", 0.001, 0.0, 0.0599)], {"a": 1.0, "b": 1.0}) == {}


@pytest.mark.parametrize("sunk", [0.0, 0.5, 0.95])
def test_what_lies_a_little_in_the_floor_of_a_box_is_not_pushed_out_beneath_its_walls(sunk: float) -> None:
    size = (0.15, 0.15, 0.12)
    box = Solid("box", size, (0.0, 0.0, 0.5 * size[2]), shape=container(size))
    ball = Solid("ball", BALL, (0.02, -0.01, WALL * (1.0 - sunk) + 0.5 * BALL[2]), shape=ROUND)
    assert separate([box, ball], {"box": 1.0, "ball": 1.0}) == {}
    through = ball.moved((0.07, 0.0, ball.position[2]))
    assert separate([box, through], {"ball": 1.0})["ball"][0] < 0.5 * size[0] - WALL - 0.5 * BALL[0] + 0.001


def test_of_pairs_of_the_same_solids_nothing_is_worked_out_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def counted(a: Polygon, b: Polygon) -> bool:
        asked.append(a)
        return are_apart(a, b)

    monkeypatch.setattr(placement, "are_apart", counted)
    solids = [cube(str(k), 0.05 * (k % 5), 0.05 * (k // 5)) for k in range(25)]
    weights, known = dict.fromkeys(map(str, range(25)), 1.0), Pairs()
    assert separate(solids, weights, known=known) == {}
    first = len(asked)
    moved = [*solids[:-1], solids[-1].moved((0.18, 0.2, 0.02))]
    pushed = separate(moved, weights, known=known)
    again = len(asked) - first
    assert pushed.keys() == {"23", "24"} and pushed == separate(moved, weights)
    assert again < 0.5 * first, "only pairs with what has moved"


def test_in_a_heap_only_outlines_are_compared_that_reach_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    far: list[float] = []

    def counted(a: Polygon, b: Polygon) -> bool:
        far.append(max(abs(a[0][k] + a[2][k] - b[0][k] - b[2][k]) / 2.0 for k in range(2)))
        return are_apart(a, b)

    monkeypatch.setattr(placement, "are_apart", counted)
    names = list(map(str, range(30)))
    pushed = separate([cube(name, 0.0, 0.0) for name in names], dict.fromkeys(names, 1.0))
    assert pushed.keys() == set(names), "all seem to be in one place"
    assert 0.0 <= max(far) < 2.0 * cube("", 0.0, 0.0).radius + GAP
