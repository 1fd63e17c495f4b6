"""Boxes overlap as deep as they have to be moved to come apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from agents.scenario.format.geometry import PlacedShape, ScenarioBox, gap_below, penetration, upright_box
from dsr.math3d.polygons import overlap
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose

CUBE = (0.04, 0.04, 0.04)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LYING = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
TABLE = PlacedShape((), (1.2, 1.2, 0.04), Pose((0.0, 0.0, -0.02), UPRIGHT))
CUP = (Part("cylinder", (0.08, 0.08, 0.1)),)


def random_box(rng: np.random.Generator) -> ScenarioBox:
    return ScenarioBox(rng.uniform(-0.05, 0.05, 3), Rotation.random(rng=rng).as_matrix(), rng.uniform(0.02, 0.1, 3))


@pytest.mark.parametrize("shift", [-0.01, -0.0004, 0.0, 0.002])
def test_aligned_boxes(shift: float):
    a, b = upright_box((0, 0, 0.02), 0, CUBE), upright_box((0.04 + shift, 0.005, 0.02), 0, CUBE)
    assert penetration(a, b) == pytest.approx(-shift, abs=1e-12)


def test_a_corner_reaches_in_further_when_turned_by_45_degrees():
    half_diagonal = 0.02 * math.sqrt(2)
    a = upright_box((0, 0, 0), math.pi / 4, CUBE)
    b = upright_box((0.02 + half_diagonal - 0.003, 0, 0), 0, CUBE)
    assert penetration(a, b) == pytest.approx(0.003, abs=1e-12)


def test_crossed_edges_need_the_edge_axes():
    a = ScenarioBox(np.zeros(3), Rotation.from_euler("x", 45, degrees=True).as_matrix(), np.array([1.0, 0.1, 0.1]))
    b = ScenarioBox(
        np.array([0, 0, 0.1 * math.sqrt(2) - 0.004]),
        Rotation.from_euler("ZX", [90, 45], degrees=True).as_matrix(),
        np.array([1.0, 0.1, 0.1]),
    )
    assert penetration(a, b) == pytest.approx(0.004, abs=1e-9)
    face_normals = np.vstack([a.rotation.T, b.rotation.T])
    along = [(a.corners @ n, b.corners @ n) for n in face_normals]
    assert min(min(p.max() - q.min(), q.max() - p.min()) for p, q in along) > 0.01


def test_penetration_is_symmetric_and_ignores_the_frame_it_is_computed_in():
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, b = random_box(rng), random_box(rng)
        turn, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
        c, d = (ScenarioBox(turn @ x.center + shift, turn @ x.rotation, x.size) for x in (a, b))
        assert penetration(a, b) == pytest.approx(penetration(b, a), abs=1e-12)
        assert penetration(a, b) == pytest.approx(penetration(c, d), abs=1e-12)


def test_overlap_agrees_with_points_sampled_in_both_boxes():
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(200):
        a, b = random_box(rng), random_box(rng)
        points = a.center + (rng.uniform(-0.5, 0.5, (4000, 3)) * a.size) @ a.rotation.T
        inside = bool((np.abs((points - b.center) @ b.rotation) < b.size / 2).all(axis=1).any())
        depth = penetration(a, b)
        if inside:
            assert depth > 0
        if depth > 0.01:
            assert inside
        seen.add(inside)
    assert seen == {True, False}


def test_footprints_ignore_height():
    a, b = upright_box((0, 0, 0), 0.3, CUBE), upright_box((0.03, 0, 5), 0.3, CUBE)
    assert overlap(a.footprint, b.footprint)[0] == pytest.approx(0.04 - 0.03 * math.cos(0.3))


def cube(x: float, y: float, z: float, yaw: float = 0.0) -> PlacedShape:
    return PlacedShape((), CUBE, Pose((x, y, z), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))))


def cup(position: Vector3, q: tuple[float, float, float, float] = LYING) -> PlacedShape:
    return PlacedShape(CUP, (0.08, 0.08, 0.1), Pose(position, q))


def test_gap_is_measured_to_the_highest_support():
    lower, upper, beside = cube(0, 0, 0.02), cube(0.01, 0, 0.063, 0.5), cube(0.3, 0, 0.0205)
    assert gap_below(lower, [upper, beside, TABLE]) == pytest.approx(0)
    assert gap_below(upper, [lower, beside, TABLE]) == pytest.approx(0.003)
    assert gap_below(beside, [lower, upper, TABLE]) == pytest.approx(0.0005)
    assert gap_below(cube(0.7, 0, 0.02), [lower, TABLE]) == math.inf


def test_what_stands_beside_holds_nothing_up():
    step = PlacedShape((), (0.2, 0.2, 0.06), Pose((0.0, 0.0, 0.03), UPRIGHT))
    for reach in (-0.001, 0.0005):  # a lying cup that is just free of the step, or a little into its side
        assert gap_below(cup((0.1 + 0.05 - reach, 0.0, 0.04)), [step, TABLE]) == pytest.approx(0.0, abs=1e-4)
    assert gap_below(cup((0.1495, 0.0, 0.05)), [step, TABLE]) == pytest.approx(0.01, abs=1e-4)


def test_a_lying_cup_rests_on_its_side_and_a_leaning_cube_on_an_edge():
    assert gap_below(cup((0.0, 0.0, 0.042)), [TABLE]) == pytest.approx(0.002, abs=1e-4)
    leaning = PlacedShape(
        (), CUBE, Pose((0.0, 0.0, 0.02 * math.sqrt(2.0)), (math.sin(math.pi / 8), 0, 0, math.cos(math.pi / 8)))
    )
    assert gap_below(leaning, [TABLE]) == pytest.approx(0.0, abs=1e-9)
    assert gap_below(leaning, [PlacedShape((), (0.4, 0.4, 0.04), Pose((0, 0, -0.03), UPRIGHT))]) == pytest.approx(0.01)


def test_what_sinks_into_its_support_has_a_negative_gap():
    assert gap_below(cube(0.0, 0.0, 0.017), [TABLE]) == pytest.approx(-0.003)
    assert gap_below(cube(0.0, 0.0, 0.055), [cube(0.005, 0.0, 0.02, 0.3), TABLE]) == pytest.approx(-0.005)
    assert gap_below(cup((0.0, 0.0, 0.035)), [TABLE]) == pytest.approx(-0.005, abs=1e-4)


def test_in_a_bowl_the_floor_carries_and_the_rim_does_not():
    walls = [Part("box", (0.005, 0.1, 0.05), (side * 0.05, 0.0, 0.025)) for side in (1, -1)]
    bowl = PlacedShape(
        (Part("box", (0.1, 0.1, 0.004), (0.0, 0.0, 0.002)), *walls), (0.105, 0.1, 0.05), Pose((0, 0, 0), UPRIGHT)
    )
    assert gap_below(cube(0.0, 0.0, 0.024), [bowl, TABLE]) == pytest.approx(0.0, abs=1e-9)
    assert gap_below(cube(0.0, 0.0, 0.029), [bowl, TABLE]) == pytest.approx(0.005)
