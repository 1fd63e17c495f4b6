"""Many transforms at once, as `dsr.math3d.transforms` does them one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.calibrator.solve import se3
from dsr.math3d import transforms
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
    assert se3.logs(given) == pytest.approx(np.array([transforms.log(pose) for pose in poses(angle)]), abs=1e-9)
    assert [se3.exp(twist) for twist in se3.logs(given)] == pytest.approx(given, abs=1e-9)
    assert se3.inverses(given) @ given == pytest.approx(np.broadcast_to(np.eye(4), given.shape), abs=1e-12)


def test_adjoints_move_twists_to_the_parent() -> None:
    twist = np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    for pose, adjoint in zip(poses(1.0), se3.adjoints(matrices(1.0)), strict=True):
        assert pose.matrix @ se3.exp(twist) == pytest.approx(se3.exp(adjoint @ twist) @ pose.matrix)


def test_jacobians_are_derivatives() -> None:
    given, step = matrices(0.2), 1e-6
    given[:, :3, 3] *= 0.1
    jacobians = se3.inverse_left_jacobians(se3.logs(given))
    for index, twist in enumerate(step * np.eye(6)):
        difference = (se3.logs(se3.exp(twist) @ given) - se3.logs(se3.exp(-twist) @ given)) / (2 * step)
        assert jacobians[:, :, index] == pytest.approx(difference, abs=1e-4)
