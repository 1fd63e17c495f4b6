"""How fast an arm may be near hands and people: speed and separation monitoring as in ISO/TS 15066, 5.5.4.

The protective separation distance is

    S = v_h (T_r + T_s) + v_r T_r + v_r T_s / 2 + C + Z

with the speeds v_h of the human and v_r of the robot, its reaction time T_r, its stopping time T_s = v_r / a, the
intrusion distance C and the uncertainty Z. Solved for v_r it tells the speed at which the arm could still stop before a
human reaches it. Where a human is closer, the arm has reduced speed (ISO 10218-1, 5.6.2). It stops when even from that
speed it would come to rest in a hand that keeps still.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.model.figure import Figure
from dsr.memory import Memory
from dsr.vocabulary.relations import is_present

Array = NDArray[np.float64]

_REACHES = {"hand": 0.1, "finger": 0.0, "person": 0.85}
"""m beyond the frame of a node that may be human: a palm's centre to the fingertips; from the body to the fingertips
(ISO 13855, 850 mm)"""


class Separation(msgspec.Struct, frozen=True):
    """Numbers of the protective separation distance."""

    monitored: bool = True
    """Whether hands and people limit the speed at all"""
    human_speed: float = 1.6
    """m/s, at which a human comes nearer if nobody measures it (ISO 13855)"""
    reaction: float = 0.1
    """s, T_r: from a hand in front of the camera to the first command, as the camera at 10 Hz tells it"""
    deceleration: float = 2.0
    """m/s^2 of the tool point when the arm brakes: 5 rad/s^2 at 0.4 m"""
    uncertainty: float = 0.03
    """m, C + Z: hands are known to about 10 mm, and the arm's boxes are wider than the arm"""
    reduced: float = 0.25
    """m/s, the reduced speed (ISO 10218-1, 5.6.2)"""

    def distance(self, robot: float, human: float) -> float:
        """The protective separation distance (m) for the speeds (m/s) of robot and human."""
        stopping = robot / self.deceleration
        return human * (self.reaction + stopping) + robot * self.reaction + robot * stopping / 2 + self.uncertainty

    def allowed(self, distance: float) -> float:
        """The greatest speed (m/s) of the tool point with a human at this distance (m); 0: the arm must stand."""
        square = 1.0 / (2.0 * self.deceleration)
        linear = self.human_speed / self.deceleration + self.reaction
        rest = self.human_speed * self.reaction + self.uncertainty - distance
        root = linear**2 - 4.0 * square * rest
        speed = (math.sqrt(root) - linear) / (2.0 * square) if root > 0.0 else 0.0
        if speed >= self.reduced:
            return speed
        return self.reduced if distance > self.distance(self.reduced, 0.0) else 0.0


class PeopleNearby:
    """The distance of humans from one arm.

    Args:
        memory: holds hands, fingertips and people.
        figure: the arm's shape.
        arm: name of the arm's node.
    """

    def __init__(self, memory: Memory, figure: Figure, arm: str) -> None:
        self._memory, self._figure, self._arm = memory, figure, arm

    def nearest(self, positions: Array, opening: float) -> tuple[float, str]:
        """Distance (m) and name of the human part nearest to the arm; infinite without any.

        Args:
            positions: (n,) rad, of the joints.
            opening: m between the fingers.
        """
        nodes = [node for node in self._memory.nodes(tuple(_REACHES)) if is_present(node)]
        if not nodes:
            return math.inf, ""
        points = self._memory.transforms(self._arm, [node.name for node in nodes])[:, :3, 3]
        gaps = self._gaps(points, positions, opening).tolist()
        found = [(gap - _REACHES[node.type], node.name) for node, gap in zip(nodes, gaps, strict=True)]
        return min([one for one in found if math.isfinite(one[0])], default=(math.inf, ""))

    def _gaps(self, points: Array, positions: Array, opening: float) -> Array:
        """(m,) m, from points (m, 3) in the arm's frame to the nearest moving box of the arm; NaN of an unknown one.

        The arm has one shape for all of them: whoever may make hands could make any number.
        """
        moving = slice(self._figure.base_boxes, None)
        centers, axes, halves = (part[0, moving] for part in self._figure.boxes(positions[None], opening))
        local = np.einsum("bji,mbj->mbi", axes, points[:, None] - centers)
        gaps: Array = np.linalg.norm(np.maximum(np.abs(local) - halves, 0.0), axis=2).min(axis=1)
        return gaps
