"""Free places for arrows and labels: the nearest ones, and at a cost that does not grow with those that are taken."""

from __future__ import annotations

import time

import numpy as np

from agents.viewer.free_places import BESIDE, Column, FreeHeights, FreeLevels
from agents.viewer.layout import arrange

HEIGHT = 22.0
"""px of a label"""
COLUMN = Column(0.0, 100.0, 50.0, tuple(52.0 * row for row in range(8)))


def nearest_level(wanted: float, taken: set[float]) -> float:
    """As one would find it who looks at all."""
    grid = BESIDE * round(wanted / BESIDE)
    steps = (grid + sign * step * BESIDE for step in range(1000) for sign in (1, -1))
    hidden = [(row - 12.0, row + 34.0) for row in COLUMN.rows]
    return next(y for y in steps if y not in taken and not any(low < y < high for low, high in hidden))


def test_each_arrow_has_the_nearest_free_level() -> None:
    chance, free = np.random.default_rng(1), FreeLevels(COLUMN)
    taken: set[float] = set()
    for wanted in chance.normal(200.0, 60.0, 300).tolist():
        expected = nearest_level(wanted, taken)
        assert free.take(wanted) == expected
        taken.add(expected)


def test_each_label_has_the_nearest_free_height() -> None:
    chance, free = np.random.default_rng(2), FreeHeights()
    taken: list[float] = []
    for _ in range(300):
        heights = chance.normal(0.0, 200.0, chance.integers(1, 4)).round().tolist()
        steps = (heights[0] + sign * step * HEIGHT for step in range(1, 1000) for sign in (1, -1))
        expected = next(y for y in [*heights, *steps] if all(abs(other - y) >= HEIGHT for other in taken))
        assert free.take(heights, 1000) == expected
        taken.append(expected)


def test_where_there_is_no_room_for_a_label_it_stands_where_it_would() -> None:
    free = FreeHeights()
    assert [free.take([0.0], 2) for _ in range(4)] == [0.0, HEIGHT, -HEIGHT, 0.0]


def test_four_times_as_many_nodes_take_about_four_times_as_long() -> None:
    def seconds(count: int) -> float:
        nodes = {"world": "world"} | {f"n{number}": "cube" for number in range(count)}
        edges = [(f"n{(7 * number) % count}", f"n{number}", "near") for number in range(count)]
        edges += [(f"n{number // 2}" if number else "world", f"n{number}", "RT") for number in range(count)]
        begin = time.process_time()
        arrange(nodes, edges)
        return time.process_time() - begin

    seconds(200)
    few, many = (min(seconds(count) for _ in range(3)) for count in (500, 2000))
    assert many < 8.0 * few, f"{few:.3f} s, {many:.3f} s"


def test_many_leaves_of_one_node_take_few_columns() -> None:
    nodes = {"table": "table"} | {f"n{number}": "cube" for number in range(3000)}
    drawing = arrange(nodes, [(f"n{number}", "table", "on") for number in range(3000)])
    assert len({node.at[0] for node in drawing.nodes}) <= 101
    assert sum(len(edge.path) for edge in drawing.edges) < 110 * 2 * 3000
