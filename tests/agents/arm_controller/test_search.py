"""Ways that are searched: found through gaps, free all along, shorter than before, the same for the same seed."""

from __future__ import annotations

import itertools
from collections.abc import Generator
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.arm_controller.motion.search import CHUNK, Draw, _Tree, is_free, search, shortened
from agents.arm_controller.motion.trajectory import SPACING

T = TypeVar("T")
Array = NDArray[np.float64]
START, GOAL = np.array([-0.8, 0.0]), np.array([0.8, 0.0])


def result(work: Generator[None, None, T]) -> T:
    while True:
        try:
            next(work)
        except StopIteration as end:
            value: T = end.value
            return value


def free(rows: Array, spare: float = 0.0) -> NDArray[np.bool_]:
    """A wall at x = 0 with a gap at y from 0.7 to 0.9, all by `spare` wider."""
    y = rows[:, 1]
    return np.asarray((np.abs(rows[:, 0]) > 0.1 - spare) | ((y > 0.7 - spare) & (y < 0.9 + spare)))


def nearly(rows: Array) -> NDArray[np.bool_]:
    """Between two points that are checked a line is off by half of their distance at most."""
    return free(rows, SPACING / 2)


def walled(rows: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(rows[:, 0]) > 0.1)


def found(seed: int) -> Array:
    return result(search(START, GOAL, free, drawing(seed)))


def length(way: Array) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def check(way: Array) -> None:
    assert way[0] == pytest.approx(START) and way[-1] == pytest.approx(GOAL)
    assert all(is_free(one, other, nearly) for one, other in itertools.pairwise(way))


@pytest.mark.parametrize("seed", range(5))
def test_a_gap_is_found_and_the_way_through_it_is_short(seed: int) -> None:
    way = found(seed)
    check(way)
    short = result(shortened(way, free, np.random.default_rng(seed)))
    check(short)
    shortest = 2 * np.hypot(0.7, 0.7) + 0.2  # by the lower end of the gap
    assert shortest - 0.03 <= length(short) < 1.1 * shortest and length(short) <= length(way)


def test_where_nothing_is_in_the_way_it_is_straight() -> None:
    way = result(search(START, GOAL, lambda rows: np.ones(len(rows), dtype=bool), drawing(0)))
    assert length(way) == pytest.approx(1.6)


def test_where_there_is_no_way_the_search_goes_on_as_long_as_somebody_asks() -> None:
    work = search(START, GOAL, walled, drawing(0))
    for _ in range(3000):
        next(work)


@pytest.mark.parametrize("seed", range(5))
def test_trees_that_do_not_meet_are_begun_anew_until_they_do(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.arm_controller.motion.search.FIRST", 1)
    begun = []

    class Counted(_Tree):
        def __init__(self, root: Array) -> None:
            begun.append(root)
            super().__init__(root)

    monkeypatch.setattr("agents.arm_controller.motion.search._Tree", Counted)
    check(found(seed))
    assert len(begun) > 4


def test_the_same_seed_gives_the_same_way() -> None:
    assert np.array_equal(found(3), found(3))


@pytest.mark.parametrize("at", [1, CHUNK - 1, CHUNK, 2 * CHUNK + 2, 50])
def test_one_point_that_is_not_free_makes_a_line_not_free(at: int) -> None:
    line = np.linspace(0.0, 1.0, 51)[at]
    assert not is_free(np.zeros(1), np.ones(1), lambda rows: np.abs(rows[:, 0] - line) > 0.005)


def drawing(seed: int) -> Draw:
    rng = np.random.default_rng(seed)
    return lambda: rng.uniform(-1.0, 1.0, 2)
