"""The same scene has the same outcome whatever was simulated before; outcomes are what physics says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from dsr.math3d import quaternions
from simulation_handler.physics import rest
from simulation_handler.physics.rollouts.engine import Engine, RolloutOutcome
from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene
from simulation_handler.physics.simulator import SimulationError
from tests.simulation_handler.rollouts.scenes import CUBE, cube, random_scene, scene_of


@pytest.fixture
def engine() -> Iterator[Engine]:
    engine = Engine()
    yield engine
    engine.close()


def fresh(scene: RolloutScene, seconds: float) -> RolloutOutcome:
    engine = Engine()
    try:
        return engine.run(scene, seconds)
    finally:
        engine.close()


def never_end_early(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rest.Rest, "look", lambda *_: False)


def test_outcomes_are_bit_identical_whatever_ran_before(engine: Engine, monkeypatch: pytest.MonkeyPatch):
    """Also after runs long enough for Bullet's timers of sleep (2 s), which cannot be reset."""
    never_end_early(monkeypatch)
    rng = np.random.default_rng(7)
    jobs = {seed: (random_scene(seed), float(rng.choice([0.25, 0.5, 2.6]))) for seed in range(10)}
    alone = {seed: fresh(*job) for seed, job in jobs.items()}
    history = rng.integers(0, len(jobs), 40).tolist()
    for seed in (seed for pair in zip(history, history, strict=True) for seed in pair):
        assert engine.run(*jobs[seed]) == alone[seed], seed


def test_when_it_ends_does_not_depend_on_what_ran_before(engine: Engine, monkeypatch: pytest.MonkeyPatch):
    """A run ends at once if nothing has moved since the scene's poses, whatever the last scene's were."""
    monkeypatch.setattr(rest, "_STILL", 1.0)
    low, high = scene_of(cube("a", 0.0, 0.0, 0.1)), scene_of(cube("a", 0.0, 0.0, 5.0))
    assert [engine.run(scene, 0.5).seconds for scene in (low, high, low)] == [8 / 240] * 3


def test_moving_and_holding_the_same_bodies_is_bit_identical_too(engine: Engine):
    scene = scene_of(*(cube(f"cube_{k}", 0.06 * k, 0.0) for k in range(5)), cube("top", 0.0, 0.0, 0.0601))
    moved = scene.moved({"top": ((0.13, 0.01, 0.07), (0.0, 0.1, 0.0, 0.99))})
    variants = [moved.held(["top"]), scene, moved, scene.without(["cube_0"]), scene.held(["cube_2"]), moved]
    alone = [fresh(variant, 0.5) for variant in variants]
    assert [engine.run(variant, 0.5) for variant in variants] == alone
    assert [engine.run(variant, 0.5) for variant in reversed(variants)] == alone[::-1]


def test_a_settled_stack_stays_and_is_done_early(engine: Engine):
    bodies = (cube("a", 0.0, 0.0), cube("b", 0.0, 0.0, 0.06), cube("c", 0.0, 0.0, 0.1))
    outcome = engine.run(scene_of(*bodies), 5.0)
    assert outcome.at_rest and 0.0 < outcome.seconds < 0.5
    assert max(outcome.drift.values()) < 5e-4
    pairs = [(contact.upper, contact.lower) for contact in outcome.contacts]
    assert pairs == [("a", "table"), ("b", "a"), ("c", "b")]


@pytest.mark.parametrize("overhang", [1e-5, 1e-4, 1e-3])
def test_what_topples_slowly_is_not_taken_to_be_at_rest(engine: Engine, overhang: float):
    support = RolloutBody("support", CUBE, (0.0, 0.0, 0.02), fixed=True)
    outcome = engine.run(scene_of(support, cube("a", 0.02 + overhang, 0.0, 0.06)), 3.0)
    assert outcome.poses["a"][0][2] == pytest.approx(0.02, abs=2e-3)


def test_an_early_end_changes_nothing_that_matters(engine: Engine, monkeypatch: pytest.MonkeyPatch):
    early = [engine.run(random_scene(seed), 3.0) for seed in range(12)]
    never_end_early(monkeypatch)
    full = [engine.run(random_scene(seed), 3.0) for seed in range(12)]
    assert any(outcome.seconds < 2.0 for outcome in early) and all(outcome.seconds == 3.0 for outcome in full)
    for ended, whole in zip(early, full, strict=True):
        for name, (position, _) in ended.poses.items():
            assert position == pytest.approx(whole.poses[name][0], abs=5e-4)


def test_a_cube_in_the_air_falls_and_is_moving_meanwhile(engine: Engine):
    outcome = engine.run(scene_of(cube("a", 0.0, 0.0, 0.5)), 0.1)
    assert outcome.drift["a"] == pytest.approx(0.5 * 9.81 * 0.1**2, rel=0.05)
    assert outcome.speeds["a"][0] == pytest.approx(0.981, rel=0.05)
    assert not outcome.at_rest and outcome.contacts == [] and outcome.seconds == pytest.approx(0.1)


def test_a_cube_goes_on_as_it_moved_and_turned(engine: Engine):
    thrown = cube("a", 0.0, 0.0, 0.5)._replace(velocity=(0.5, 0.0, 1.0), spin=(0.0, 0.0, 2.0))
    outcome = engine.run(scene_of(thrown), 0.1)
    position, rotation = outcome.poses["a"]
    assert position == pytest.approx((0.05, 0.0, 0.5 + 0.1 - 0.5 * 9.81 * 0.1**2), abs=3e-3)
    assert quaternions.to_rotvec(rotation) == pytest.approx((0.0, 0.0, 0.2), abs=0.01)
    still = scene_of(thrown).moved({"a": (thrown.position, thrown.rotation)})
    assert still == scene_of(cube("a", 0.0, 0.0, 0.5))
    assert engine.run(still, 0.1) == fresh(still, 0.1) and engine.run(scene_of(thrown), 0.1) == outcome


def test_a_held_cube_stays_in_the_air_and_carries(engine: Engine):
    scene = scene_of(cube("a", 0.0, 0.0, 0.3), cube("b", 0.0, 0.0, 0.34))
    outcome = engine.run(scene.held(["a"]), 1.0)
    assert outcome.poses["a"] == (scene["a"].position, scene["a"].rotation)
    assert [(contact.upper, contact.lower) for contact in outcome.contacts] == [("b", "a")]
    assert engine.run(scene.held(["a"]).released(["a"]), 1.0).drift["a"] > 0.25


def test_nothing_is_simulated_in_no_time(engine: Engine):
    scene = scene_of(cube("a", 0.0, 0.0, 0.5))
    outcome = engine.run(scene, 0.0)
    assert outcome.seconds == 0.0 and outcome.drift == {"_floor": 0.0, "a": 0.0, "table": 0.0}


def test_a_scene_without_bodies_is_at_rest(engine: Engine):
    assert engine.run(RolloutScene(()), 1.0).poses == {}


@pytest.mark.parametrize("seconds", [-0.1, float("nan"), float("inf")])
def test_times_that_cannot_be_simulated_are_refused(engine: Engine, seconds: float):
    with pytest.raises(SimulationError, match="cannot be simulated"):
        engine.run(scene_of(), seconds)


def test_after_a_body_that_cannot_be_the_engine_goes_on(engine: Engine):
    good = scene_of(cube("a", 0.0, 0.0, 0.1))
    expected = engine.run(good, 0.2)
    with pytest.raises(SimulationError, match="body 'b': size"):
        engine.run(scene_of(cube("a", 0.0, 0.0), cube("b", 0.1, 0.0)._replace(size=(0.0, 0.1, 0.1))), 0.2)
    assert engine.run(good, 0.2) == expected
