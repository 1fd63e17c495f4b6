"""Whether a thing got elsewhere bit by bit or at once, told by its percepts."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.vocabulary import nats
from simulation_handler.perception.ways import by_way

NOISE, REACH = 0.003, 0.1
"""m"""


def told(xs: np.ndarray, seed: int) -> float:
    offsets = np.outer(xs, (0.6, 0.0, 0.8)) + np.random.default_rng(seed).normal(0.0, NOISE, (len(xs), 3))
    return by_way(offsets, NOISE**2, REACH)


@pytest.mark.parametrize("seed", range(10))
def test_what_gets_on_bit_by_bit_did_not_jump(seed: int) -> None:
    assert told(np.array([0.0] * 8 + [0.01 * k for k in range(1, 7)]), seed) > nats.RARE
    assert told(np.array([0.0] * 4 + [0.01 * k for k in range(1, 7)] + [0.06] * 8), seed) > nats.RARE


@pytest.mark.parametrize("seed", range(10))
def test_a_jump_is_no_way(seed: int) -> None:
    assert told(np.array([0.0] * 8 + [0.04] * 6), seed) < -nats.RARE


def test_what_stays_where_it_was_or_is_not_seen_tells_of_no_way() -> None:
    assert told(np.zeros(14), 0) < nats.RARE
    assert by_way(np.zeros((0, 3)), NOISE**2, REACH) == 0.0
