"""A snapshot of the graph at one moment, with all from which actions are inferred."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.handling import Handling

FOUND_OUT = 1.5
"""s, longer than it takes until it is known that a hand came back empty, that a thing is missing, or a camera bumped"""


class ObservedGrasp(NamedTuple):
    """An edge `grasping`."""

    holder: str
    """Node of a hand or gripper."""
    since: float
    """Begin of the grasp, s."""
    probability: float = 1.0
    """1, that it is so by the belief"""


class ObservedEnd(NamedTuple):
    """An edge `let_go`."""

    holder: str
    """Node of the hand that held the thing last."""
    time: float
    """s, until when it did, as far as is known"""
    how: str = Handling.FREE
    """`Handling` in the end"""


@dataclass(frozen=True)
class ObservedThing:
    """An object."""

    name: str
    size: Vector3 = (0.0, 0.0, 0.0)
    """Edge lengths of its bounding box, m."""
    perceived: bool = False
    plausible: bool = True
    seen: Pose | None = None
    """world_from_object of the newest percept, with its stamp."""
    in_doubt: bool = False
    """Whether the camera of the percept may have been bumped."""
    believed: Pose | None = None
    """world_from_object"""
    on: frozenset[str] = frozenset()
    """Names of the supports of the thing."""
    inside: frozenset[str] = frozenset()
    """Names of the containers of the thing."""
    lies: float = 1.0
    """1, probability by the belief that it is on or in what it is said to be; 1 if it is said to be on nothing"""
    grasps: tuple[ObservedGrasp, ...] = ()
    """Grasps of the thing, the newest last."""
    lifted: float | None = None
    """s, when what holds it, or held it last, took it up from where it lay, as is believed; None if nothing has"""
    let_go: ObservedEnd | None = None
    """How the last grasp by a hand ended; None while one grasps it, or if none is known to have"""

    def bottom(self, pose: Pose) -> float:
        """World z of its lowest point at `pose`, by its bounding box, m."""
        down = quaternions.to_matrix(pose.q)[2]
        return pose.t[2] - 0.5 * sum(abs(part) * edge for part, edge in zip(down, self.size, strict=True))

    def distance(self, point: Vector3, pose: Pose) -> float:
        """Distance (m) from a point to the thing's bounding box at `pose`; 0 inside."""
        local = quaternions.rotate(
            quaternions.conjugate(pose.q), (point[0] - pose.t[0], point[1] - pose.t[1], point[2] - pose.t[2])
        )
        return math.hypot(*(max(0.0, abs(x) - 0.5 * edge) for x, edge in zip(local, self.size, strict=True)))


class Holder(NamedTuple):
    """A hand or a gripper."""

    name: str
    points: tuple[Vector3, ...]
    """Points (m, world) where the holder can hold something: the palm first, then fingertips."""
    perceived: bool = True
    """Whether the holder's present place is known."""
    shows_fingers: bool = True
    """Whether the holder's fingers are known: one is seen now, or it is a gripper."""


@dataclass(frozen=True)
class Snapshot:
    """One moment."""

    now: float
    """Time of the snapshot, s."""
    things: Mapping[str, ObservedThing] = field(default_factory=dict)
    holders: Mapping[str, Holder] = field(default_factory=dict)
    floor_below: float = -math.inf
    """m, world z below which a thing that lies still lies on the floor: well below all tables"""

    def shows_fingers(self, holder: str) -> bool:
        """Whether the state of a holder's fingers is known now."""
        known = self.holders.get(holder)
        return known is not None and known.perceived and known.shows_fingers

    def palm_height(self, holder: str) -> float | None:
        """World z of a holder's palm, m; None if it is not known now."""
        known = self.holders.get(holder)
        return known.points[0][2] if known is not None and known.perceived and known.points else None
