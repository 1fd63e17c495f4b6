"""Keeps where objects last lay, and since when what holds them has had them higher than that: they were taken up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from dsr.math3d.transforms import Pose
from simulation_handler.scales import ASTRAY
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject


class _Height(NamedTuple):
    """How high an object is believed to be."""

    time: float
    """s"""
    bottom: float
    """m, world z of its lowest point"""
    centre: float
    """m, world z of its centre"""

    def above(self, rest: _Height) -> float:
        """How much higher it is than there, m. Bottom and centre must agree: it may be tipped over."""
        return min(self.bottom - rest.bottom, self.centre - rest.centre)


class Lifting:
    """Tells which objects were taken up from where they lay, and when.

    An object has been taken up if a hand or gripper holds it, and it is believed higher than it lay, by as much as
    what has fallen is lower. When it left is where the line through its first two heights above that meets it.
    """

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._rests: dict[str, _Height] = {}
        self._before: dict[str, _Height] = {}
        self._lifted: dict[str, float] = {}

    @property
    def lifted(self) -> Mapping[str, float]:
        """When (s) each object was last taken up that something holds, or held last."""
        return self._lifted

    def forget(self, name: str) -> None:
        """Forget an object that is no more."""
        for known in (self._rests, self._before, self._lifted):
            known.pop(name, None)

    def update(self, poses: Mapping[str, Pose], now: float) -> None:
        """Take in where objects are believed to be at time `now` (s), world_from_object."""
        for name, pose in poses.items():
            item = self._bodies.objects[name]
            height = _height(item.solid(pose.t, pose.q), now)
            if _lies(item):
                self._rests[name] = height
            elif item.hand or item.holder:
                self._take_in(name, height)
            self._before[name] = height

    def _take_in(self, name: str, height: _Height) -> None:
        rest = self._rests.get(name)
        if rest is None or height.above(rest) <= ASTRAY:
            return
        before = self._before.get(name, rest)
        rise, earlier = height.above(rest), max(before.above(rest), 0.0)
        share = earlier / (rise - earlier) if rise > earlier else 0.0
        self._lifted[name] = max(before.time - share * (height.time - before.time), rest.time)
        del self._rests[name]


def _height(solid: Solid, now: float) -> _Height:
    return _Height(now, solid.bottom, solid.position[2])


def _lies(item: BelievedObject) -> bool:
    """Whether nothing holds an object, which lies still on something as far as is believed."""
    is_held = item.hand or item.holder or item.static
    return not is_held and not item.driven and item.hovering_since is None and not item.gone
