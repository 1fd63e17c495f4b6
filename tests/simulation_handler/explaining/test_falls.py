"""A cube that topples off another one while the camera looks on: where it lies in the end, its tag unseen."""

from __future__ import annotations

import math

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.physics.simulator import TIME_STEP, Simulator
from tests.simulation_handler.explaining.scenes import tower
from tests.simulation_handler.worlds import CUBE, TABLE, World

CLOSE = 0.04
"""m, an edge"""
PERIOD = 0.05  # s between the poses of a fall


def fall(world: World, speed: float, heading: float) -> list[Pose]:
    """True poses of the upper cube after a push that lets it go at `speed` m/s in the direction `heading` (rad)."""
    with Simulator(sleeping=False) as sim:
        sim.add_body("table", TABLE, (), (0.35, 0.0, -0.02), friction=0.7)
        for name, pose in world.truths.items():
            sim.add_body(name, CUBE, (), pose.t, pose.q, mass=0.05, friction=0.7)
        velocity = (speed * math.cos(heading), speed * math.sin(heading), 0.0)
        sim.place("c1", *sim.pose("c1"), velocity)
        poses = []
        for _ in range(20):
            sim.step(round(PERIOD / TIME_STEP))
            poses.append(Pose(*sim.pose("c1")))
        return poses


@pytest.mark.parametrize("heading", [0.2, 1.4, 2.5, 3.7])
@pytest.mark.parametrize("speed", [0.5, 0.6])
def test_it_is_believed_where_it_fell(heading: float, speed: float) -> None:
    world = tower(2, seed=round(10 * heading))
    for pose in fall(world, speed, heading):
        world.truths["c1"] = pose
        world.tick()
    world.run(2.0)
    assert "fell(c1)" in [explanation.text for _, explanation in world.belief.explanations()]
    assert world.truths["c1"].t[2] == pytest.approx(0.02, abs=1e-3)
    assert world.error("c1") < CLOSE
    assert world.error("c0") < 0.005
