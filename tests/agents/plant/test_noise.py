"""The noise of the depth camera is that which was measured."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest

from agents.plant.noise import BASELINE, DISPARITY_NOISE, FARTHEST, SensorModel, shift_bodies
from agents.scenario.format.scenario import SensorSpec
from dsr.vocabulary.intrinsics import Intrinsics

LENS = Intrinsics.from_fov(160, 120, 0.98)


def sensor(seed: int = 0, **spec: object) -> SensorModel:
    return SensorModel(SensorSpec(**spec), ["a", "b"], np.random.default_rng(seed))


def flat(distance: float) -> np.ndarray:
    return np.full((LENS.height, LENS.width), distance, np.float32)


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_depth_error_grows_with_the_square_of_the_distance(distance: float) -> None:
    measured = sensor().depth(flat(distance), LENS)
    expected = distance**2 / (LENS.fx * BASELINE) * DISPARITY_NOISE
    assert measured.std() == pytest.approx(expected, rel=0.25)
    assert measured.mean() == pytest.approx(distance, abs=expected)


def test_depth_comes_in_steps() -> None:
    assert len(np.unique(sensor().depth(flat(0.6), LENS))) < 60


def test_depth_is_unknown_where_there_is_nothing_in_reach() -> None:
    assert not sensor().depth(flat(0.0), LENS).any()
    assert not sensor().depth(flat(FARTHEST + 1), LENS).any()


def test_pixels_drop_out_at_jumps_only() -> None:
    depth = flat(0.6)
    depth[:, 80:] = 0.7
    missing = sensor().depth(depth, LENS) == 0
    assert missing[:, 79:81].mean() == pytest.approx(0.7, abs=0.15)
    assert not missing[:, :78].any() and not missing[:, 82:].any()


def test_grey_noise_is_alike_in_all_channels() -> None:
    noisy = sensor(grey_noise=3.0).color(np.full((120, 160, 3), 128, np.uint8)).astype(float)
    assert noisy[..., 0].std() == pytest.approx(3.0, rel=0.1)
    assert (noisy[..., 0] == noisy[..., 2]).all()


def test_grey_noise_is_normal_in_whole_levels_and_repeats_with_the_seed() -> None:
    """Each level is as frequent as a normal number that is rounded to it, and the colours end at black and white."""
    grey = np.full((480, 640, 3), 128, np.uint8)
    one, same, other = (sensor(seed, grey_noise=2.0).color(grey) for seed in (1, 1, 2))
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    off, normal = one[..., 0].astype(int) - 128, NormalDist(0.0, 2.0)
    for level in range(-7, 8):
        expected = off.size * (normal.cdf(level + 0.5) - normal.cdf(level - 0.5))
        assert (off == level).sum() == pytest.approx(expected, abs=5.0 * np.sqrt(expected) + off.size / 65536)
    assert 7 <= np.abs(off).max() <= 12
    ends = sensor(grey_noise=100.0).color(np.array([[[0, 128, 255]]] * 1000, np.uint8))
    assert ends[..., 0].min() == 0 and ends[..., 2].max() == 255
    assert (ends[..., 0] > 0).mean() == pytest.approx(0.5, abs=0.1) and (ends[..., 2] < 255).mean() > 0.4
    assert np.array_equal(sensor(grey_noise=0.0).color(grey), grey)


def test_errors_are_bias_plus_jitter_and_repeat_with_the_seed() -> None:
    one, same, other = (sensor(seed, depth_bias=(0.005, 0.015), depth_jitter=0.003) for seed in (1, 1, 2))
    assert one.bias == same.bias != other.bias
    assert all(0.005 <= bias <= 0.015 for bias in one.bias.values())
    samples = np.array([one.errors()["a"] for _ in range(300)])
    assert samples.mean() == pytest.approx(one.bias["a"], abs=0.001)
    assert samples.std() == pytest.approx(0.003, rel=0.2)


def test_bodies_move_along_their_viewing_rays() -> None:
    bodies = np.full((LENS.height, LENS.width), -1, np.int32)
    bodies[:, :40] = 7
    shifted = shift_bodies(flat(0.6), bodies, {7: 0.01}, LENS)
    assert (shifted[:, 40:] == np.float32(0.6)).all()
    u, v = 5, 60
    ray = np.array([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, 1.0])
    assert np.linalg.norm(ray) * (0.6 - shifted[v, u]) == pytest.approx(0.01, abs=1e-6)
