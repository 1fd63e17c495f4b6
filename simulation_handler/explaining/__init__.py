"""Explains surprises, by the method that the configuration names.

Read `situation` (what is known), `hypotheses` (what may have happened), `drafting` (where things would be),
`scoring` (how well that explains what is seen), `search`, and the policy `by_hypotheses`.
"""

from __future__ import annotations

from dsr.clock import WALL_CLOCK, Clock, ManualClock
from dsr.config.plugins import EXPLAINERS, load
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.by_hypotheses import ByHypotheses
from simulation_handler.explaining.policy import ExplainingPolicy, Explanation
from simulation_handler.explaining.situation import VisibilityQuery
from simulation_handler.physics.rollouts.pool import Pool

__all__ = ["ExplainingPolicy", "Explanation", "VisibilityQuery", "make_policy"]


def make_policy(config: BeliefConfig, clock: Clock = WALL_CLOCK) -> ExplainingPolicy:
    """The policy that `config` names; `clock` measures its budget where processes simulate.

    On a manual clock no time passes while they do: everything is simulated right here then.
    """
    if config.policy != "hypotheses":
        policy: ExplainingPolicy = load(EXPLAINERS, config.policy)()
        return policy
    workers = 0 if isinstance(clock, ManualClock) else config.workers
    return ByHypotheses(Pool(workers, clock=clock), clock)
