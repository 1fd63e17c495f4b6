"""Lets fingertips push objects that perception does not hold in place: unseen objects that no hand holds.

Each fingertip that is near such an object is a sphere in the simulation, pulled along the way that it was seen to take.
What is seen goes by its percepts and what is held is driven: those the spheres go through, and so they need not lift.
Noise must push nothing: the spheres are smaller than fingertips, they follow only what moves farther than noise, and
one that begins inside an object, as far as that can be noise, is shifted out of it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import FASTEST_SEEN, FRAME, LIKELY_SIGMAS
from simulation_handler.contact.containment import Containment
from simulation_handler.hands.fingertips import DEEPEST, NEAR
from simulation_handler.hands.state import UNSEEN
from simulation_handler.hands.touching import Touching
from simulation_handler.motion.driving import HURRY
from simulation_handler.perception.paths import Path
from simulation_handler.physics.simulator import FINGER_RADIUS
from simulation_handler.scales import GONE_FROM, PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

_SPHERE_LAG = FRAME  # s by which a sphere is behind what is seen: the newest place is smoothed with the next image
_SPHERE_SLACK = LIKELY_SIGMAS * PLACE_FLOOR  # m that a fingertip may move without its sphere


@dataclass
class _Tip:
    """A fingertip in sight."""

    played: float
    """s, up to which it has followed its way"""
    place: Vector3
    """m, there"""
    shift: Vector3 = (0.0, 0.0, 0.0)
    """m by which its sphere is beside it"""
    met: set[str] = field(default_factory=set)
    """Objects that it pushes"""

    @property
    def centre(self) -> Vector3:
        """Of its sphere, m."""
        return _sum(self.place, self.shift)


class Fingers:
    """Decides which fingertips push which objects, and moves them."""

    def __init__(self, bodies: Bodies, touching: Touching, containment: Containment) -> None:
        self._bodies = bodies
        self._touching = touching
        self._containment = containment
        self._tips: dict[str, _Tip] = {}
        self._loose: dict[str, Solid] = {}
        self._now = -math.inf

    def update(self, now: float, count: int, waiting: Collection[str]) -> None:
        """Let fingertips move to where they were at `now` (s) over the next `count` steps of physics.

        Objects that are `waiting` for an explanation are seen elsewhere than they are believed to be.
        """
        seconds, self._now = min(now - self._now, 2.0 * UNSEEN), now
        paths = self._touching.paths()
        before, self._loose = self._loose.keys(), self._find_loose(now, waiting)
        for name in sorted(self._tips.keys() - paths.keys()):
            del self._tips[name]
            self._bodies.sim.fingers.remove(name)
        for name, path in paths.items():
            tip = self._tips.get(name)
            if tip is None:
                tip = self._tips[name] = _Tip(now - _SPHERE_LAG, _at(path, now - _SPHERE_LAG))
            self._go_back(tip, path, now, self._loose.keys() - before)
            self._go_on(name, tip, path, now, seconds, count)

    def note_pushes(self) -> None:
        """Forget the percepts of objects from before they were pushed; call this after physics."""
        for thing in sorted({thing for tip in self._tips.values() for thing in tip.met}):
            item = self._bodies.objects.get(thing)
            if item is not None and item.track.estimate is not None and self._bodies.has_left(item):
                item.leave_to_physics()

    def _find_loose(self, now: float, waiting: Collection[str]) -> dict[str, Solid]:
        """What fingertips push, where it is."""
        return {
            name: self._bodies.solid(name)
            for name, item in self._bodies.objects.items()
            if self._is_loose(item, now) and name not in waiting
        }

    def _is_loose(self, item: BelievedObject, now: float) -> bool:
        """Whether neither percepts nor anything that holds an object say where it is."""
        is_held = item.is_led or bool(item.hand) or item.static
        return item.name in self._bodies.sim and not is_held and now - item.track.last_stamp > UNSEEN

    def _go_back(self, tip: _Tip, path: Path, now: float, new: Collection[str]) -> None:
        """Play again how a fingertip may have pushed what is only now known to be unseen, since it was last seen."""
        if tip.met:
            return
        stamps = [self._bodies.objects[name].track.last_stamp for name in new if self._is_near(path.last.t, name)]
        if stamps:
            tip.played = min(tip.played, max(min(stamps), now - 2.0 * UNSEEN))
            tip.place = _at(path, tip.played)

    def _go_on(self, name: str, tip: _Tip, path: Path, now: float, seconds: float, count: int) -> None:
        late = now - _SPHERE_LAG - tip.played
        tip.played += min(late, HURRY * seconds) if late > 0.0 else 0.0
        place = _followed(tip.place, _at(path, tip.played), FASTEST_SEEN * seconds)
        fingers = self._bodies.sim.fingers
        if name in fingers and math.dist(fingers.position(name), tip.centre) > GONE_FROM:  # it is stuck
            fingers.remove(name)
            tip.met, tip.shift = set(), (0.0, 0.0, 0.0)
        near = [thing for thing in self._loose if self._is_near(tip.place, thing) or self._is_near(place, thing)]
        tip.met &= set(near)
        for thing in near:
            if thing not in tip.met and self._is_outside(tip, thing):
                tip.met.add(thing)
        if not tip.met:
            fingers.remove(name)
            tip.place, tip.shift = place, (0.0, 0.0, 0.0)
            return
        if name not in fingers:
            fingers.add(name, tip.centre)
        fingers.meet(name, tip.met)
        tip.place = place
        if all(self._overlap(place, thing)[0] <= 0.0 for thing in tip.met):
            tip.shift = (0.0, 0.0, 0.0)
        fingers.move(name, tip.centre, count)

    def _is_near(self, point: Vector3, thing: str) -> bool:
        """Whether a fingertip there could push an object soon; what is in something seen only from within that."""
        solid = self._loose[thing]
        if math.dist(point, solid.position) > solid.radius + FINGER_RADIUS + NEAR:
            return False
        if self._overlap(point, thing)[0] < -NEAR:
            return False
        hollows = [hollow for inner, hollow in self._containment.current() if inner == thing]
        return all(
            hollow in self._loose or self._bodies.solid(hollow).reaches_around(point, 0.0)
            for hollow in hollows
            if hollow in self._bodies.sim
        )

    def _is_outside(self, tip: _Tip, thing: str) -> bool:
        """Whether a sphere may meet an object from now on; one that is in it by noise is shifted out."""
        overlap, (x, y, z) = self._overlap(tip.centre, thing)
        if overlap > DEEPEST:
            return False
        if overlap > 0.0:
            tip.shift = _sum(tip.shift, (overlap * x, overlap * y, overlap * z))
        return True

    def _overlap(self, point: Vector3, thing: str) -> tuple[float, Vector3]:
        """How far (m) a sphere there is in an object, and the way out."""
        distance, normal = self._loose[thing].signed_distance(point)
        return FINGER_RADIUS - distance, normal


def _at(path: Path, stamp: float) -> Vector3:
    """Where a fingertip was seen, m; it is not guessed where it is going."""
    return path.at(min(stamp, path.newest)).t


def _followed(here: Vector3, there: Vector3, most: float) -> Vector3:
    """Towards a fingertip, up to the slack, and by `most` m at most."""
    metres = math.dist(here, there)
    if metres <= _SPHERE_SLACK:
        return here
    share = min(metres - _SPHERE_SLACK, most) / metres
    x, y, z = (a + share * (b - a) for a, b in zip(here, there, strict=True))
    return x, y, z


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
