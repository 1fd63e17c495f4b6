"""What an explanation may cost in time: a machine that is slow at all else must not keep it from being found."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from dsr.clock import WallClock
from simulation_handler.explaining.by_hypotheses import ByHypotheses
from simulation_handler.physics.rollouts.pool import Pool
from simulation_handler.physics.rollouts.scene import RolloutScene
from tests.simulation_handler.worlds import World, cube_at


class SlowClock(WallClock):
    """Between two looks at it, ten seconds pass."""

    passed = 0.0

    def monotonic(self) -> float:
        self.passed += 10.0
        return self.passed


class PoolWithWorkers(Pool):
    """Simulates here what workers would simulate, and nothing without time."""

    pids = (1,)

    def run(self, scenes: Sequence[RolloutScene], seconds: float, budget: float | None = None) -> list[object]:  # type: ignore[override]
        self.budgets.append(budget)
        return super().run(scenes, seconds) if budget else [None] * len(scenes)

    budgets: list[float | None]


def test_what_takes_long_to_draft_is_simulated_all_the_same() -> None:
    pool = PoolWithWorkers(0)
    pool.budgets = []
    clock = SlowClock()
    world = World({"cube": cube_at(0.35, 0.0), "other": cube_at(0.35, 0.2)}, rays=True)
    world.belief._explainer._policy = ByHypotheses(pool, clock)
    world.run(2.0)
    world.truths["cube"] = cube_at(0.45, -0.1)
    world.run(2.0)
    assert pool.budgets[0] == pytest.approx(world.belief.config.explain_budget)
    assert world.error("cube") < 0.005
