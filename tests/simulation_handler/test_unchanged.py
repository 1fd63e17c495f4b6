"""What rests where it was put, among what has not moved, is not placed anew at each percept."""

from __future__ import annotations

from collections import Counter

import pytest

from simulation_handler.contact.placement import separate
from simulation_handler.motion import correction
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE, World, cube_at


@pytest.fixture
def placed(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each object was placed anew."""
    counts: Counter[str] = Counter()
    place = correction.place

    def counting(percept: Solid, *args: object) -> correction.Placement:
        counts[percept.name] += 1
        return place(percept, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(correction, "place", counting)
    return counts


def _deviation(world: World, name: str) -> float:
    placement = world.belief._bodies.objects[name].placement
    assert placement is not None
    return float(placement.covariance[0, 0])


def test_what_rests_is_placed_anew_seldom_and_known_ever_better(placed: Counter[str]) -> None:
    world = World({"cube_1": cube_at(0.3, 0.1), "cube_2": cube_at(0.3, -0.1)})
    world.run(4.0)
    placed.clear()
    before = _deviation(world, "cube_1")
    world.run(2.0)
    assert 1 <= placed["cube_1"] <= 8, "of twenty percepts"
    assert _deviation(world, "cube_1") < 0.8 * before


def test_what_stands_on_something_is_placed_anew_when_that_has_moved(placed: Counter[str]) -> None:
    world = World({"low": cube_at(0.3, 0.0), "high": cube_at(0.3, 0.0, 0.06), "far": cube_at(0.3, 0.3)})
    world.run(4.0)
    placed.clear()
    world.truths |= {"low": cube_at(0.304, 0.0), "high": cube_at(0.304, 0.0, 0.06)}
    world.run(2.0)
    assert placed["high"] > placed["far"]
    assert world.belief.supports().keys() == {("low", "table"), ("high", "low"), ("far", "table")}
    for name in ("low", "high"):
        pose = world.belief.pose(name)
        assert pose is not None and abs(pose.t[0] - 0.304) < 0.002


def test_only_what_was_placed_and_what_it_is_pushed_into_gives_way() -> None:
    solids = [Solid(name, CUBE, (x, 0.0, 0.02)) for name, x in (("a", 0.0), ("b", 0.038), ("c", 0.079), ("d", 0.3))]
    solids.append(Solid("e", CUBE, (0.338, 0.0, 0.02)))
    weights = dict.fromkeys("abcde", 1.0)
    assert separate(solids, weights).keys() == set("abcde")
    pushed = separate(solids, weights, {"a"})
    assert pushed.keys() == set("abc")
    assert all(pushed[name] == there for name, there in separate(solids[:3], weights).items())
    assert separate(solids, weights, ()) == {}
