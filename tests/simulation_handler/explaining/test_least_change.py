"""Of explanations that are as good, the one is taken that changes the least of what was believed, heights included."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dsr.clock import ManualClock
from dsr.math3d.transforms import Pose
from dsr.vocabulary import nats
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.by_hypotheses import ByHypotheses
from simulation_handler.explaining.camera import _consensus, explained_by_camera
from simulation_handler.explaining.drafting import Draft
from simulation_handler.explaining.hypotheses import Hypothesis, Move
from simulation_handler.explaining.least_change import with_least_change
from simulation_handler.explaining.piles import piles_beneath
from simulation_handler.explaining.scoring import Score, score
from simulation_handler.explaining.search import Candidate
from simulation_handler.explaining.situation import Properties, Seen, Situation
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.physics.rollouts import Pool
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE

TABLE = Solid("table", (2.0, 2.0, 0.04), (0.0, 0.0, -0.02), fixed=True)
NAMES = ("a", "b", "c")


def cube(name: str, x: float, level: int, y: float = 0.0) -> Solid:
    return Solid(name, CUBE, (x, y, 0.02 + 0.04 * level))


def seen(solid: Solid) -> Seen:
    return Seen(solid, 4e-6 * np.eye(3), 1e-3 * np.eye(3), count=10, moving=False)


def situation(believed: list[Solid], percepts: list[Solid]) -> Situation:
    """No relations are known: only where things are believed to be."""
    properties = {solid.name: Properties(0.05, 0.7) for solid in (*believed, *percepts)}
    return Situation(
        now=10.0,
        config=BeliefConfig(),
        fixtures={"table": TABLE},
        believed={solid.name: solid for solid in believed},
        properties=properties | {"table": Properties(0.0, 0.7)},
        seen={solid.name: seen(solid) for solid in percepts},
        surprising=tuple(sorted(solid.name for solid in percepts)),
    )


@pytest.mark.parametrize("order", list(itertools.permutations(NAMES)))
def test_a_tower_that_was_moved_as_a_whole_keeps_its_order(order: tuple[str, ...]) -> None:
    """Whatever the cubes are called, and though nothing is known but how high each of them was believed to be."""
    tower = [cube(name, 0.0, level) for level, name in enumerate(order)]
    here = situation([*tower, cube("top", 0.0, 3)], [cube("top", 0.3, 3)])
    assert piles_beneath(here, "top", here.believed, ())[0] == order
    policy = ByHypotheses(Pool(0), clock=ManualClock())
    explanation = policy.explain(replace(here, planned=frozenset(("top", name) for name in order)))
    policy.close()
    assert explanation is not None and explanation.text == f"put_back_under({', '.join(reversed(order))}; top)"
    for level, name in enumerate(order):
        assert explanation.solids[name].position == pytest.approx((0.3, 0.0, 0.02 + 0.04 * level), abs=0.002)


@pytest.mark.parametrize("order", list(itertools.permutations(NAMES)))
def test_of_unseen_objects_that_fit_alike_the_nearest_came(order: tuple[str, ...]) -> None:
    others = [cube(name, 0.2 * (1 + place), 0) for place, name in enumerate(order)]
    here = situation([*others, cube("top", -0.5, 0)], [cube("top", 0.0, 1)])
    assert piles_beneath(here, "top", here.believed, ())[0] == (order[0],)
    assert piles_beneath(here, "top", here.believed, {order[2]})[0] == (order[2],), "it is missing where it was"


def test_what_is_only_just_seen_was_not_moved_unseen() -> None:
    pair = [cube("below", 0.0, 0), cube("top", 0.0, 1)]
    here = replace(situation(pair, [cube("top", 0.3, 1)]), beneath={"top": ("below",)})
    assert here.chain_beneath("top") == ("below",) and piles_beneath(here, "top", here.believed, ())
    glanced = replace(here, glanced=frozenset({"below"}))
    assert not glanced.chain_beneath("top") and not piles_beneath(glanced, "top", glanced.believed, ())


def test_of_many_unseen_objects_those_count_that_are_near_not_those_that_come_first_by_name() -> None:
    far = [cube(f"a{number}", 0.6, 0, 0.1 * number) for number in range(12)]
    here = situation([*far, cube("z", 0.0, 0), cube("top", 0.0, 1)], [cube("top", 0.1, 1)])
    assert piles_beneath(here, "top", here.believed, ())[0] == ("z",)


def candidate(name: str, x: float, total: float, *, held: bool = False) -> Candidate:
    """`name` came from x to beneath the top."""
    hypothesis = Hypothesis().with_move(Move("top", beneath=(name,), held=held))
    settled = {"top": cube("top", 0.0, 1), name: cube(name, 0.0, 0)}
    return Candidate(hypothesis, Draft(settled, {}, frozenset()), settled, Score(total, ()))


def test_what_is_as_good_is_decided_by_change_and_all_else_by_score() -> None:
    here = situation([cube("a", 0.5, 0), cube("b", 0.1, 0), cube("top", -0.5, 0)], [cube("top", 0.0, 1)])
    far, near = candidate("a", 0.5, 8.0), candidate("b", 0.1, 8.0 + 0.9 * nats.AS_GOOD)
    assert with_least_change(here, [far, near]) == [near, far]
    worse = candidate("b", 0.1, 8.0 + 1.1 * nats.AS_GOOD)
    assert with_least_change(here, [far, worse]) == [far, worse]
    held = candidate("b", 0.1, 8.0, held=True)
    assert with_least_change(here, [far, held]) == [far, held], "it assumes something else"
    assert with_least_change(here, []) == []


def test_what_hides_something_does_not_depend_on_the_order_of_cameras() -> None:
    """One camera does not look there, from another an object hides it, from a third the arm does."""
    here = situation([cube("a", 0.0, 0), cube("top", 0.0, 1)], [cube("a", 0.0, 0)])
    nowhere, hidden, arm = ExpectedVisibility(0.0, ""), ExpectedVisibility(0.0, "top"), ExpectedVisibility(0.0, "link")
    nothing = Hypothesis()
    drafted = Draft(here.believed, {}, frozenset())

    def total(*visibilities: ExpectedVisibility) -> float:
        of_a = {f"camera_{number}": visible for number, visible in enumerate(visibilities)}
        looked = replace(here, visibility=lambda solids, _: [of_a if one.name == "a" else {} for one in solids])
        return score(looked, nothing, drafted, here.believed).total

    assert total(nowhere, hidden) == total(hidden, nowhere) > total(nowhere, nowhere)
    assert total(arm, hidden) == total(hidden, arm) == total(nowhere, nowhere), "the arm may be seen past"


@pytest.mark.parametrize("names", ["abcde", "edcba"])
def test_of_two_motions_of_the_camera_that_explain_as_much_the_smaller_one_does(names: str) -> None:
    """Two seem to have moved by 5 cm, two have not, and of the fifth nobody can tell."""
    believed = [cube(name, 0.2 * place, 0, 0.1 * (place % 2)) for place, name in enumerate(names)]
    shifts = [0.05, 0.05, 0.025, 0.0, 0.0]
    here = situation(believed, believed)
    noise = {names[2]: 0.05**2}
    percepts = {
        solid.name: replace(
            seen(solid.moved((solid.position[0] + shift, *solid.position[1:]))),
            covariance=np.diag([noise.get(solid.name, 25e-6), 25e-6, 25e-6]),
        )
        for solid, shift in zip(believed, shifts, strict=True)
    }
    assert explained_by_camera(replace(here, seen=percepts)) == frozenset(names[2:])


@pytest.mark.parametrize("moved", [(), ("b",)])
def test_a_camera_that_was_turned_is_found_by_things_that_tell_no_rotation(moved: tuple[str, ...]) -> None:
    """Each place by itself tells a shift alone, by which others seem to be more than 30 mm off."""
    places = {"a": (-0.35, -0.2), "b": (-0.1, 0.35), "c": (0.3, 0.1), "d": (0.1, -0.35), "e": (0.35, -0.2)}
    believed = [cube(name, x, 0, y) for name, (x, y) in places.items()]
    motion = Pose.from_rotvec((0.03, -0.02, 0.0), (0.0, 0.0, 0.12))
    percepts = {}
    for solid in believed:
        x, y, z = (motion @ Pose(solid.position)).t
        shown = solid.moved((x, y + 0.1 * (solid.name in moved), z))
        percepts[solid.name] = replace(seen(shown), turning=10.0 * np.eye(3))
    here = replace(situation(believed, believed), seen=percepts)
    assert explained_by_camera(here) == frozenset(places) - set(moved)


def test_in_a_crowd_few_motions_of_the_camera_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """All of a hundred cubes are seen 10 mm off, but for two that seem to have changed places."""
    believed = [cube(f"cube_{n}", 0.05 * (n // 10), 0, 0.05 * (n % 10)) for n in range(100)]
    shown = {solid.name: solid.moved((solid.position[0] + 0.01, *solid.position[1:])) for solid in believed}
    for name, other in (("cube_0", "cube_99"), ("cube_99", "cube_0")):
        x, y, z = believed[int(other.removeprefix("cube_"))].position
        shown[name] = shown[name].moved((x + 0.01, y, z))
    here = replace(situation(believed, believed), seen={name: seen(solid) for name, solid in shown.items()})
    tried = []

    def consensus(*given: Any) -> frozenset[str]:
        tried.append(given)
        return _consensus(*given)

    monkeypatch.setattr("simulation_handler.explaining.camera._consensus", consensus)
    assert explained_by_camera(here) == shown.keys() - {"cube_0", "cube_99"}
    assert len(tried) <= 3


@pytest.mark.parametrize("seed", range(20))
def test_a_turned_camera_is_found_among_two_clusters_of_things_that_tell_no_rotation(seed: int) -> None:
    """Each cluster by itself seems to have been shifted; three from both tell how the camera was turned."""
    rng = np.random.default_rng(seed)
    middles = [(-0.35, -0.3), (0.35, 0.3)]
    places = [tuple(np.array(middles[n % 2]) + rng.normal(0.0, 0.05, 2)) for n in range(6)]
    believed = [cube(f"cube_{n}", x, 0, y) for n, (x, y) in enumerate(places)]
    motion = Pose.from_rotvec((0.02, -0.03, 0.0), (0.0, 0.0, 0.12))
    percepts = {}
    for solid in believed:
        (x, y, z), (dx, dy) = (motion @ Pose(solid.position)).t, rng.normal(0.0, 0.002, 2)
        shown = solid.moved((x + dx + 0.1 * (solid.name == "cube_5"), y + dy, z))
        percepts[solid.name] = replace(seen(shown), turning=10.0 * np.eye(3))
    here = replace(situation(believed, believed), seen=percepts)
    assert explained_by_camera(here) == percepts.keys() - {"cube_5"}
