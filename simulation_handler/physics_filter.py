"""The physics filter: another world, in which things are where the belief simulator's physics lets them be."""

from __future__ import annotations

from dsr import main
from dsr.worlds.hosting import Hosted
from simulation_handler.agent import SimulationHandler


class PhysicsFilter(Hosted):
    """Keeps an overlay of a world in which physics corrects where things are perceived to be.

    `stable` shows all of `base`, live, and beside it what the simulation handler believes: `Virtual_RT`, `on`, `in`,
    `sees`, `plausible`; `base` keeps what was perceived. Not to be run beside a simulation handler of the base, for
    both would answer what-if questions.
    """

    name = "physics"
    reads = ("base",)
    writes = "stable"
    hosts = SimulationHandler


if __name__ == "__main__":
    main(PhysicsFilter)
