"""Simulates scenes one after the other in one physics client: the same scene has the same outcome, bit for bit.

What a client has simulated before leaves traces in it. Measured with pybullet 3.2.7, what is bit-identical to a new
client: bodies removed and added again; and bodies put elsewhere whose contacts are forgotten, as long as none has
ever slept. What is not: bodies that slept (also the fixtures: their timers go on), a body whose mass was set to zero
and back, and `restoreState` after either. Hence nothing sleeps here, and held bodies are made anew. A new client
would be simplest, but it takes 17 to 80 ms and 28 MB; this takes 3 us a body that stays, and 0.1 ms for a new one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile

from simulation_handler.physics.rest import STRIDE, Rest
from simulation_handler.physics.rollouts.scene import STILL, Placing, RolloutBody, RolloutScene
from simulation_handler.physics.simulator import TIME_STEP, Contact, SimulationError, Simulator


class LateError(SimulationError):
    """Nobody waits for the outcome of a rollout any more."""


@dataclass(frozen=True)
class RolloutOutcome:
    """The state of a scene after a rollout."""

    poses: dict[str, Placing]
    """world_from_body of all bodies, by name."""
    contacts: list[Contact]
    """Contacts between bodies, sorted; pairs of fixed bodies are left out."""
    drift: dict[str, float]
    """Distance (m) of each body's centre from its place in the scene, by name."""
    speeds: dict[str, tuple[float, float]]
    """m/s and rad/s of each body."""
    seconds: float
    """s that were simulated: less than asked for if all came to rest before, and would have stayed there."""

    @property
    def at_rest(self) -> bool:
        """Whether nothing moved any more at the end."""
        return all(linear == angular == 0.0 for linear, angular in self.speeds.values())


class Engine:
    """Simulates scenes in a physics client of its own. Not thread-safe."""

    def __init__(self) -> None:
        self._sim = Simulator(sleeping=False)
        self._loaded: list[RolloutBody] = []

    def close(self) -> None:
        """Free the simulation; harmless when repeated."""
        self._sim.close()

    def run(self, scene: RolloutScene, seconds: float, is_late: Callable[[], bool] = lambda: False) -> RolloutOutcome:
        """Let time pass in a scene; stops early when it is at rest.

        Args:
            scene: at the beginning.
            seconds: to simulate.
            is_late: whether nobody waits any more; asked between steps.

        Raises:
            SimulationError: for a time that is negative or not finite, or a body that no simulation can have.
            LateError: if nobody waits any more.
        """
        if not 0.0 <= seconds < math.inf:
            raise SimulationError(f"{seconds} s cannot be simulated; expected 0 or more")
        self._load(scene)
        free = [body for body in scene.bodies if not _is_fixed(body)]
        left = steps = round(seconds / TIME_STEP)
        poses = {body.name: (body.position, body.rotation) for body in free}
        rest = Rest(poses, {body.name: 0.5 * math.hypot(*body.size) for body in free})
        at_rest = False
        while left and not at_rest:
            if is_late():
                raise LateError(f"nobody waits for the other {left * TIME_STEP:.1f} s of a simulation")
            count = min(left, STRIDE)
            self._sim.step(count)
            left -= count
            poses = {body.name: self._sim.pose(body.name) for body in free}
            at_rest = count == STRIDE and rest.look(poses)
        return self._outcome(scene, poses, (steps - left) * TIME_STEP, at_rest)

    def _load(self, scene: RolloutScene) -> None:
        """Make the simulation hold the scene's bodies, in the scene's order, with nothing left of earlier runs."""
        pairs = zip(self._loaded, scene.bodies, strict=False)
        kept = len(list(takewhile(lambda pair: _what_stays(pair[0]) == _what_stays(pair[1]), pairs)))
        for body in self._loaded[kept:]:
            self._sim.remove(body.name)
        del self._loaded[kept:]
        for body in scene.bodies[kept:]:
            mass = 0.0 if _is_fixed(body) else body.mass
            self._sim.add_body(
                body.name, body.size, body.shape, body.position, body.rotation,
                mass=mass, friction=body.friction, rolling_friction=body.rolling_friction,
            )  # fmt: skip
            self._loaded.append(body)
        for body in scene.bodies:
            if not _is_fixed(body):
                self._sim.place(body.name, body.position, body.rotation, body.velocity, body.spin)

    def _outcome(
        self, scene: RolloutScene, moved: Mapping[str, Placing], seconds: float, at_rest: bool
    ) -> RolloutOutcome:
        poses = {body.name: moved.get(body.name, (body.position, body.rotation)) for body in scene.bodies}
        still = (0.0, 0.0)
        return RolloutOutcome(
            poses=poses,
            contacts=self._sim.contacts() if seconds else [],
            drift={body.name: math.dist(body.position, poses[body.name][0]) for body in scene.bodies},
            speeds={name: still if at_rest or name not in moved else self._sim.speed(name) for name in poses},
            seconds=seconds,
        )


def _is_fixed(body: RolloutBody) -> bool:
    return body.fixed or body.mass == 0.0


def _what_stays(body: RolloutBody) -> RolloutBody:
    """What must be equal for a simulated body to be used again: all of a fixed one, all but the motion of another."""
    if _is_fixed(body):
        return body
    return body._replace(position=STILL, rotation=(0.0, 0.0, 0.0, 1.0), velocity=STILL, spin=STILL)
