"""When what no explanation helps is looked at again."""

from __future__ import annotations

import pytest

from simulation_handler.explaining.policy import Explanation
from simulation_handler.explaining.situation import Situation
from tests.simulation_handler.worlds import World, cube_at


@pytest.mark.parametrize(("helps", "most"), [(False, 6), (True, 100)])
def test_what_an_explanation_leaves_as_surprising_as_before_waits_for_more_evidence(helps: bool, most: int) -> None:
    """It may be worth seconds of work, and said the same twenty times a second."""
    world = World({"cube": cube_at(0.35, 0.0), "other": cube_at(0.35, 0.2)}, rays=True)
    world.run(1.0)
    asked: list[float] = []

    def explain(situation: Situation) -> Explanation:
        asked.append(world.now)
        left = frozenset[str]() if helps else frozenset(situation.surprising)
        return Explanation((), situation.surprising, unexplained=left)

    world.belief._explainer._policy.explain = explain  # type: ignore[method-assign]
    world.seen.remove("cube")  # it should be seen, and is not
    world.run(5.0)
    assert 2 <= len(asked) <= most
    assert helps == (len(asked) > 10)


def test_what_is_seen_elsewhere_since_is_explained_anew() -> None:
    """What no explanation helped where it was may have one where it is now."""
    world = World({"cube": cube_at(0.35, 0.0), "other": cube_at(0.35, 0.2)}, rays=True)
    world.run(1.0)
    asked: list[float] = []

    def explain(situation: Situation) -> Explanation:
        asked.append(world.now)
        return Explanation((), situation.surprising, unexplained=frozenset(situation.surprising))

    world.belief._explainer._policy.explain = explain  # type: ignore[method-assign]
    for step in range(20):
        world.truths["cube"] = cube_at(0.35, 0.015 * step - 0.1)
        world.run(0.1)
    assert len(asked) > 4


def test_bodies_are_put_in_one_order_in_whatever_order_an_explanation_names_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Physics depends on it a little: the same seed would give another run."""
    world = World({name: cube_at(0.35, 0.08 * place - 0.1) for place, name in enumerate("bcad")}, rays=True)
    world.run(1.0)
    bodies, put = world.belief._bodies, list[str]()

    def explain(situation: Situation) -> Explanation:
        moved = {name: situation.believed[name].moved((0.35, 0.1 * k, 0.3)) for k, name in enumerate("dbca")}
        monkeypatch.setattr(bodies, "put", lambda item, position, rotation: put.append(item.name))
        return Explanation((), situation.surprising, moved)

    world.belief._explainer._policy.explain = explain  # type: ignore[method-assign]
    world.seen.remove("a")
    while not put:
        world.run(0.05)
    assert put[:4] == ["a", "b", "c", "d"]
