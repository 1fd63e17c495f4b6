"""Time passes for bodies that move, and need not be simulated for those at rest."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.physics.rest import STRIDE
from simulation_handler.physics.simulator import MOST_STEPS
from simulation_handler.state.bodies import FLOOR, Bodies
from tests.simulation_handler.worlds import CUBE


@pytest.fixture
def bodies() -> Iterator[Bodies]:
    """A cube that rests on a table."""
    made = Bodies(BeliefConfig())
    made.set_fixture("table", (1.0, 1.0, 0.04), Pose((0.0, 0.0, -0.02)))
    made.put(made.add_object("lower", CUBE, 0.05, 0.5), (0.0, 0.0, 0.02), (0.0, 0.0, 0.0, 1.0))
    made.sim.step(100)
    yield made
    made.sim.close()


@pytest.fixture
def steps(bodies: Bodies, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many steps each call of the simulation was asked for."""
    counted, step = list[int](), bodies.sim.step

    def counting(count: int = 1) -> None:
        counted.append(count)
        step(count)

    monkeypatch.setattr(bodies.sim, "step", counting)
    return counted


def test_what_rests_is_simulated_for_a_moment_alone(bodies: Bodies, steps: list[int]) -> None:
    before = bodies.sim.position("lower")
    bodies.pass_time(MOST_STEPS)
    assert steps == [STRIDE]
    assert bodies.sim.position("lower") == pytest.approx(before, abs=1e-6)


def test_all_steps_pass_while_something_falls(bodies: Bodies, steps: list[int]) -> None:
    bodies.put(bodies.add_object("upper", CUBE, 0.05, 0.5), (0.2, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0))
    bodies.pass_time(MOST_STEPS)
    assert sum(steps) == MOST_STEPS
    assert bodies.sim.position("upper")[2] < 0.15


def test_few_steps_pass_as_they_are(bodies: Bodies, steps: list[int]) -> None:
    """An agent that keeps its rate simulates as it ever did, bit by bit."""
    bodies.pass_time(2 * STRIDE - 1)
    assert steps == [2 * STRIDE - 1]


def test_what_is_about_to_fall_is_no_less_simulated(bodies: Bodies, steps: list[int]) -> None:
    """A cube with its middle just beyond the edge of another one begins slowly."""
    bodies.put(bodies.add_object("upper", CUBE, 0.05, 0.5), (0.021, 0.0, 0.06), (0.0, 0.0, 0.0, 1.0))
    for _ in range(10):
        bodies.pass_time(MOST_STEPS)
    assert bodies.sim.position("upper")[2] < 0.03


def test_the_floor_is_below_the_lowest_table_and_costs_no_look_at_all_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else each tick costs by the square of the tables that somebody makes up: 3000 took 2 s."""
    made = Bodies(BeliefConfig())

    def floor() -> float:
        return made.fixtures[FLOOR].top + BeliefConfig().floor_below_table

    def put(name: str, height: float) -> None:
        made.set_fixture(name, (1.0, 1.0, 0.02), Pose((0.0, 0.0, height - 0.01)))

    for name, height, lowest in (("a", 0.7, 0.7), ("b", 0.4, 0.4), ("c", 0.9, 0.4), ("b", 0.8, 0.7), ("b", 0.2, 0.2)):
        put(name, height)
        assert floor() == pytest.approx(lowest)
    made.remove("b")
    put("a", 0.7)
    assert floor() == pytest.approx(0.7)
    monkeypatch.setattr(made, "_lay_floor", lambda: pytest.fail("all tables are looked at"))
    put("a", 0.7)
    put("d", 0.9)
