"""The simulated world follows the most probable one, once what is missing was explained."""

from __future__ import annotations

from typing import cast

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.relations import ContactRelations
from simulation_handler.state.bodies import Bodies
from simulation_handler.worlds.alternatives import GONE, Mode
from simulation_handler.worlds.following import WeightFollowing
from simulation_handler.worlds.weighted import WeightedWorlds


class Gone:
    """Worlds in most of which an object is gone."""

    def leading(self, name: str) -> tuple[str, Mode]:
        return GONE, Mode(0.9, None)


@pytest.mark.parametrize("is_answered", [False, True])
def test_what_is_probably_gone_stays_in_the_simulation_until_its_absence_was_explained(is_answered: bool) -> None:
    bodies = Bodies(BeliefConfig())
    try:
        cube = bodies.add_object("cube", (0.04, 0.04, 0.04), 0.05, 0.5)
        bodies.put(cube, (0.0, 0.0, 0.02), Pose().q)
        following = WeightFollowing(bodies, ContactRelations(0.2), cast(WeightedWorlds, Gone()))
        following.update(frozenset() if is_answered else {"cube"})
        assert ("cube" in bodies.sim) != is_answered
    finally:
        bodies.sim.close()
