"""Whether a thing is lifted, from samples of its height that are more or less sure."""

from __future__ import annotations

import numpy as np
import pytest

from agents.action_inference.heights import Height, Heights
from dsr.math3d.transforms import Pose


def percepts(sigma: float, *bottoms: float) -> Heights:
    """One every 0.1 s, the standard deviation of each in m, of something that lay where it was first seen."""
    heights = Heights(lifted=0.015, frames=2, steady=0.008)
    covariance = np.diag([sigma**2] * 3 + [0.01] * 3)
    for index, bottom in enumerate(bottoms):
        pose = Pose((0.0, 0.0, bottom + 0.02), stamp=1.0 + 0.1 * index, covariance=covariance)
        heights.add(Height.seen(bottom, pose))
        heights.lie()
    return heights


@pytest.mark.parametrize(("sigma", "is_lifted"), [(0.002, True), (0.01, False)])
def test_what_may_be_noise_lifts_nothing(sigma: float, is_lifted: bool) -> None:
    assert percepts(sigma, 0.0, 0.0, 0.0, 0.02, 0.02).is_lifted is is_lifted
    assert percepts(sigma, 0.0, 0.0, 0.0, 0.04, 0.04).is_lifted


def test_a_percept_without_covariance_counts_as_it_is() -> None:
    assert Height.seen(0.1, Pose((0.0, 0.0, 0.2), stamp=1.0)).sigma == 0.0
    turned = Pose.from_rotvec((0.0, 0.0, 0.2), (0.5 * np.pi, 0.0, 0.0), covariance=np.diag([1e-6, 4e-6, 1e-6, 1, 1, 1]))
    assert Height.seen(0.1, turned).sigma == pytest.approx(0.002), "of the vertical, whichever axis that is"
