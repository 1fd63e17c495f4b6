"""Simulates scenes forward in time, apart from the belief."""

from simulation_handler.physics.rollouts.engine import Engine, Outcome
from simulation_handler.physics.rollouts.pool import Pool
from simulation_handler.physics.rollouts.scene import Body, Placing, Scene

__all__ = ["Body", "Engine", "Outcome", "Placing", "Pool", "Scene"]
