"""Simulates scenes forward in time, apart from the belief."""

from simulation_handler.physics.rollouts.engine import Engine, RolloutOutcome
from simulation_handler.physics.rollouts.pool import Pool
from simulation_handler.physics.rollouts.scene import Placing, RolloutBody, RolloutScene

__all__ = ["Engine", "Placing", "Pool", "RolloutBody", "RolloutOutcome", "RolloutScene"]
