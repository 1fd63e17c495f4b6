"""The belief simulator: a physics simulation kept in step with perception.

Read in the order of the data: `reading` (graph to belief), `percepts`, `estimate` and `tracking` (percepts over
time), `placement` and `supports` (onto contact), `correction` (into the simulation), `simulator`, `relations`,
`writing` (belief to graph). What the cameras should see by the belief: `views` (graph to cameras and obstacles),
`visibility` (rays), `seeing` (to the graph).
"""

from simulation_handler.agent import SimulationHandler

__all__ = ["SimulationHandler"]
