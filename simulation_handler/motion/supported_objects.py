"""Finds the objects that driven bodies take along: objects on them, in them, or pushed by their walls."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Set

import numpy as np

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.contact.containment import Containment, carried_by
from simulation_handler.contact.relations import ContactRelations
from simulation_handler.scales import TILTED
from simulation_handler.state.bodies import Bodies

Twist = tuple[Vector3, Vector3]
"""Velocity (m/s) and angular velocity (rad/s), in the world"""
HALTED: Twist = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class SupportedObjects:
    """Finds the objects that go along with driven bodies, and lets them."""

    def __init__(self, bodies: Bodies, relations: ContactRelations, containment: Containment) -> None:
        self._bodies = bodies
        self._relations = relations
        self._containment = containment

    def supported(self, leaders: Collection[str]) -> set[str]:
        """Names of the objects in or on the leaders, directly and indirectly."""
        return carried_by(leaders, [*self._relations.current(), *self._containment.current()]) if leaders else set()

    def beneath(self) -> dict[str, set[str]]:
        """Names of the supports of each object."""
        beneath: dict[str, set[str]] = {}
        for upper, lower in self._relations.current():
            beneath.setdefault(upper, set()).add(lower)
        return beneath

    def standing(self, drives: Set[str]) -> dict[str, list[str]]:
        """List the objects that stand, directly and indirectly, on each driven object that is about upright, and on
        nothing else.

        What a hand does gently shifts none of that; but the way of a body is as unsteady as percepts are.
        """
        beneath, found = self.beneath(), dict[str, list[str]]()
        for name in sorted(beneath.keys() - drives):
            item = self._bodies.objects.get(name)
            base = only_base(name, beneath, drives)
            if base is None or item is None or item.static or item.holder or name not in self._bodies.sim:
                continue
            if self._bodies.solid(base).face_down()[1] < TILTED:
                found.setdefault(base, []).append(name)
        return found

    def take_along(self, load: str, base: Pose, before: Twist, after: Twist) -> None:
        """Change the velocity of an object on a driven body, at `base`, as the body's velocity changes."""
        position, (linear, spin) = self._bodies.sim.position(load), self._bodies.sim.velocity(load)
        arm = np.subtract(position, base.t)
        turn = np.subtract(after[1], before[1])
        push = np.subtract(after[0], before[0]) + np.cross(turn, arm)
        x, y, z = (linear + push).tolist()
        a, b, c = (spin + turn).tolist()
        self._bodies.sim.set_velocity(load, (x, y, z), (a, b, c))

    def pushed(self, speeds: Mapping[str, float], loads: Mapping[str, list[str]]) -> dict[str, float]:
        """Find the objects that walls of upright driven containers push along, with the most sideways speed (m/s) of
        each.

        Their bodies follow noise, too, and would throw what rolls to the other side.
        """
        standing = {load for names in loads.values() for load in names}
        found: dict[str, float] = {}
        for name, container in self._containment.current():
            is_upright = container in speeds and self._bodies.solid(container).face_down()[1] < TILTED
            if is_upright and name not in standing and name not in speeds and name in self._bodies.sim:
                found[name] = max(found.get(name, 0.0), speeds[container])
        return found

    def slow_down(self, name: str, most: float) -> None:
        """Let a body move sideways by at most `most` m/s."""
        (x, y, z), spin = self._bodies.sim.velocity(name)
        speed = math.hypot(x, y)
        if speed > most:
            share = most / speed
            self._bodies.sim.set_velocity(name, (share * x, share * y, z), (share * spin[0], share * spin[1], spin[2]))


def only_base(name: str, beneath: Mapping[str, set[str]], drives: Set[str]) -> str | None:
    """The one driven object on which something stands, also indirectly; None if it stands on anything else, too."""
    found: set[str] = set()
    level, known = {name}, {name}
    while level:
        lower = {base for upper in level for base in beneath.get(upper, {""})}
        if "" in lower:
            return None
        found |= lower & drives
        level = lower - found - known
        known |= level
    return found.pop() if len(found) == 1 else None
