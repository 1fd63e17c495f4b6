"""Lets the simulated world be the most probable one: takes away what is gone, and puts back what is in something."""

from __future__ import annotations

from collections.abc import Collection

from simulation_handler.contact.relations import ContactRelations
from simulation_handler.state.bodies import Bodies
from simulation_handler.worlds.alternatives import GONE, INSIDE_OF
from simulation_handler.worlds.weighted import WeightedWorlds


class WeightFollowing:
    """Changes the simulated world where its alternatives clearly are more probable."""

    def __init__(self, bodies: Bodies, relations: ContactRelations, worlds: WeightedWorlds) -> None:
        self._bodies = bodies
        self._relations = relations
        self._worlds = worlds

    def update(self, expected: Collection[str]) -> None:
        """Follow what the worlds say now. Only unseen objects have alternatives.

        Args:
            expected: names of objects that cameras should see: if they do not, an explanation tells why.
        """
        for name, item in self._bodies.objects.items():
            found = self._worlds.leading(name)
            if found is None or item.is_led or item.hand:
                continue
            kind, mode = found
            if kind == GONE and name in self._bodies.sim and name not in expected:
                self._bodies.take_away(item)
                self._relations.forget(name)
            elif item.gone and kind.startswith(INSIDE_OF) and mode.pose is not None:
                item.leave_to_physics()
                self._bodies.put(item, mode.pose.t, mode.pose.q)
