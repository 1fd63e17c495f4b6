"""The percepts of one object from one camera: what they tell is reckoned once, until something changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dsr import Pose
from surprise.config import SurpriseConfig
from surprise.evidence import EvidenceTrack
from surprise.misfit import Misfit, misfit

EYE = (0.0, 0.0, 1.0)
NOISE = np.diag([1e-6] * 3 + [1e-5] * 3)
BELIEVED = Pose((0.3, 0.0, 0.02)).with_covariance(NOISE)


def percept(track: EvidenceTrack, stamp: float, x: float) -> None:
    track.add(stamp, Pose((x, 0.0, 0.02)).with_covariance(NOISE), EYE, [BELIEVED], lambda _: BELIEVED)


@pytest.mark.parametrize("change", ["add", "belief_changed", "belief_jumped"])
def test_what_percepts_tell_is_reckoned_anew_when_something_changes(
    change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    reckoned = []

    def count(*given: Any) -> Misfit:
        reckoned.append(given)
        return misfit(*given)

    monkeypatch.setattr("surprise.evidence.misfit", count)
    track = EvidenceTrack("camera", SurpriseConfig())
    for number in range(4):
        percept(track, 0.1 * number, 0.33)
    before = track.misfit()
    assert track.misfit() is before and len(reckoned) == 1 and before.nats > 0.0
    there = Pose((0.33, 0.0, 0.02)).with_covariance(NOISE)
    changes: dict[str, Callable[[], None]] = {
        "add": lambda: percept(track, 0.4, 0.33),
        "belief_changed": lambda: track.belief_changed(there),
        "belief_jumped": lambda: track.belief_jumped(there),
    }
    changes[change]()
    after = track.misfit()
    assert len(reckoned) == 2 and after != before
    assert after == misfit([one.deviation for one in track.span()], track.bias)
