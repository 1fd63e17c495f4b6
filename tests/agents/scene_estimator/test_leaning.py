"""Rotations that are tried of what was never seen upright."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from agents.object_models import load_model, model_files
from agents.scene_estimator import leaning
from agents.scene_estimator.fitting import Fit
from dsr.math3d import quaternions


def test_of_nearly_all_rotations_one_that_is_tried_is_as_near_as_a_fit_may_lead() -> None:
    rotations, rng = np.array(leaning._all_rotations()), np.random.default_rng(0)
    drawn = Rotation.random(3000, random_state=rng).as_matrix()
    cosines = 0.5 * (np.einsum("nij,mij->nm", drawn, rotations).max(axis=1) - 1.0)
    assert np.quantile(np.arccos(np.clip(cosines, -1.0, 1.0)), 0.99) < leaning._FARTHEST


def test_what_is_turned_over_is_elsewhere_although_most_of_its_surface_is_where_it_was() -> None:
    cup = load_model(model_files()["cup"])
    upright, over = (
        Fit(np.zeros(3), np.array(quaternions.to_matrix(turn)), 1.0, 1.0, 0.001)
        for turn in ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0))
    )
    assert leaning._apart(cup.shape, cup.size, upright, over) > 0.01
    assert leaning._apart(cup.shape, cup.size, upright, upright) < 0.001
