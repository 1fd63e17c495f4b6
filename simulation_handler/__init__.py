"""The belief simulator: a physics simulation kept in step with perception.

Read in the order of the data: `reading` (graph to belief), `percepts`, `estimate` and `tracking` (percepts over
time), `placement` and `supports` (onto contact), `correction` (into the simulation), `simulator`, `relations`,
`writing` (belief to graph).
"""

from simulation_handler.agent import SimulationHandler

__all__ = ["SimulationHandler"]
