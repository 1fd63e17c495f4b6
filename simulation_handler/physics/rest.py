"""Tells when a simulated scene is at rest: further steps would leave all of it where it is."""

from __future__ import annotations

import math
from collections.abc import Mapping

from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.perception.scales import STEADY
from simulation_handler.physics.simulator import TIME_STEP
from simulation_handler.scales import GAP

_Placing = tuple[Vector3, Quaternion]
STRIDE = 8
"""Steps from one look at what still moves to the next"""
_STILL = GAP * STRIDE * TIME_STEP / STEADY
"""m that a corner moves in those steps at most when its body is at rest: by `GAP` in `STEADY`"""


class Rest:
    """Looks at bodies from stride to stride.

    Args:
        poses: world_from_body of the bodies that may move, by name.
        radii: m from the centre of each within which all of it is.
    """

    def __init__(self, poses: Mapping[str, _Placing], radii: Mapping[str, float]) -> None:
        self._radii = radii
        self._poses = poses
        self._motions = dict.fromkeys(poses, math.inf)

    def look(self, poses: Mapping[str, _Placing]) -> bool:
        """Take in where the bodies are a stride later; whether all of them will stay there."""
        motions = {name: _motion(self._radii[name], self._poses[name], pose) for name, pose in poses.items()}
        earlier, self._poses, self._motions = self._motions, poses, motions
        return all(_is_at_rest(earlier[name], motion) for name, motion in motions.items())


def _is_at_rest(earlier: float, motion: float) -> bool:
    """Whether a body that moved by `earlier` and then by `motion` m, in a stride each, will stay where it is.

    Contacts settle: a motion that gets slower by the same share in each stride goes on by motion^2 / (earlier - motion)
    in all. That must be `GAP` at most. What topples gets faster instead.
    """
    settles = motion < earlier <= GAP and motion**2 <= GAP * (earlier - motion)
    return motion <= _STILL or settles


def _motion(radius: float, before: _Placing, now: _Placing) -> float:
    """Upper bound of how far a corner has moved, m."""
    (old_position, old_rotation), (position, rotation) = before, now
    turn = 2.0 * math.dist(old_rotation, rotation)
    return math.dist(old_position, position) + radius * turn
