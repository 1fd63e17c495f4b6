"""The belief simulator: a physics simulation kept in step with perception.

Read in the order of the data: `reading` (graph to belief), `percepts`, `estimate` and `tracking` (percepts over
time), `placement` and `supports` (onto contact), `correction` (into the simulation), `simulator`, `relations`,
`writing` (belief to graph). What the cameras should see by the belief: `views` (graph to cameras and obstacles),
`visibility` (rays), `seeing` (to the graph).

The agent is loaded on first use, so that the processes that simulate hypotheses need no working memory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulation_handler.agent import SimulationHandler

__all__ = ["SimulationHandler"]


def __getattr__(name: str) -> Any:
    if name != "SimulationHandler":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from simulation_handler.agent import SimulationHandler

    return SimulationHandler
