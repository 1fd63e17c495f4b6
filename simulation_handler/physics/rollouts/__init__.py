"""Forward simulation of scenes, apart from the belief: what would happen if the objects were like this?"""

from simulation_handler.physics.rollouts.engine import Engine, RolloutOutcome
from simulation_handler.physics.rollouts.pool import Pool
from simulation_handler.physics.rollouts.scene import Placing, RolloutBody, RolloutScene

__all__ = ["Engine", "Placing", "Pool", "RolloutBody", "RolloutOutcome", "RolloutScene"]
