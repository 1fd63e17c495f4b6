"""Many transforms at once, as `dsr.math3d.transforms` does them one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dsr.math3d import batches, transforms
from dsr.math3d.transforms import Array, Pose


def poses(angle: float, count: int = 50) -> list[Pose]:
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(count, 3))
    axes *= angle / np.linalg.norm(axes, axis=1)[:, None]
    return [Pose.from_rotvec(t, axis) for t, axis in zip(rng.normal(size=(count, 3)), axes, strict=True)]


def matrices(angle: float) -> Array:
    return np.array([pose.matrix for pose in poses(angle)])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-3, 0.5, 2.0, 2.9, 3.14, math.pi - 1e-7])
def test_logarithms_and_inverses(angle: float) -> None:
    given = matrices(angle)
    assert batches.logs(given) == pytest.approx(np.array([transforms.log(pose) for pose in poses(angle)]), abs=1e-9)
    assert [transforms.exp(twist).matrix for twist in batches.logs(given)] == pytest.approx(given, abs=1e-9)
    assert batches.exps(batches.logs(given)) == pytest.approx(given, abs=1e-9)
    assert batches.inverses(given) @ given == pytest.approx(np.broadcast_to(np.eye(4), given.shape), abs=1e-12)


def test_adjoints_move_twists_to_the_parent() -> None:
    twist = np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    for pose, adjoint in zip(poses(1.0), batches.adjoints(matrices(1.0)), strict=True):
        assert (pose @ transforms.exp(twist)).matrix == pytest.approx((transforms.exp(adjoint @ twist) @ pose).matrix)


def test_jacobians_are_derivatives() -> None:
    given, step = matrices(0.2), 1e-6
    given[:, :3, 3] *= 0.1
    jacobians = batches.inverse_left_jacobians(batches.logs(given))
    for index, twist in enumerate(step * np.eye(6)):
        after, before = (batches.logs(transforms.exp(sign * twist).matrix @ given) for sign in (1.0, -1.0))
        difference = (after - before) / (2 * step)
        assert jacobians[:, :, index] == pytest.approx(difference, abs=1e-4)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 2.0, 3.0, math.pi - 1e-9])
def test_rotation_vectors_are_those_of_scipy(angle: float) -> None:
    rotations = matrices(angle)[:, :3, :3]
    assert batches.rotvecs(rotations) == pytest.approx(Rotation.from_matrix(rotations).as_rotvec(), abs=1e-8)


def test_half_turns_about_axes() -> None:
    turns = np.array([np.diag((1.0, -1.0, -1.0)), np.diag((-1.0, 1.0, -1.0)), np.diag((-1.0, -1.0, 1.0))])
    assert np.abs(batches.rotvecs(turns)) == pytest.approx(math.pi * np.eye(3))


def test_skew_matrices_are_cross_products() -> None:
    a, b = np.random.default_rng(2).normal(size=(2, 4, 5, 3))
    assert np.einsum("nkij,nkj->nki", batches.skew(a), b) == pytest.approx(np.cross(a, b))


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0, math.pi])
def test_a_rigid_motion_is_found_again(angle: float) -> None:
    source, pose = np.random.default_rng(3).normal(size=(6, 3)), poses(angle, 1)[0]
    rotation, shift = batches.rigid_fit(source, pose.apply(source))
    assert rotation == pytest.approx(pose.rotation_matrix)
    assert shift == pytest.approx(pose.t)


def test_no_motion_nearby_fits_better_nor_is_it_a_reflection() -> None:
    rng = np.random.default_rng(4)
    source, target, weights = rng.normal(size=(8, 3)), rng.normal(size=(8, 3)), rng.uniform(0.0, 1.0, 8)
    rotation, shift = batches.rigid_fit(source, target * (1.0, 1.0, -1.0), weights)
    assert np.linalg.det(rotation) == pytest.approx(1.0)

    def error(turn: Array, way: Array) -> float:
        return float(weights @ ((source @ turn.T + way - target * (1.0, 1.0, -1.0)) ** 2).sum(axis=1))

    for twist in 1e-3 * rng.normal(size=(100, 6)):
        other = transforms.exp(twist).matrix
        assert error(rotation, shift) <= error(other[:3, :3] @ rotation, shift + other[:3, 3])


def test_singular_matrices_spoil_no_others_inverses() -> None:
    given = np.random.default_rng(0).normal(size=(4, 3, 3))
    given[1, 2] = given[1, 0]
    given[1, :, 2] = 0.0
    given[2, 0, 0] = np.nan
    found, known = batches.matrix_inverses(given), np.arange(12.0).reshape(4, 3, 1)
    assert np.isnan(found[1:3]).all()
    assert found[[0, 3]] == pytest.approx(np.linalg.inv(given[[0, 3]]))
    solved = batches.solutions(given, known)
    assert np.isnan(solved[1:3]).all()
    assert given[[0, 3]] @ solved[[0, 3]] == pytest.approx(known[[0, 3]])
