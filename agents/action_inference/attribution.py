"""Attributes an action on a thing: to the hand or gripper that grasps it, or else to the nearest hand."""

from __future__ import annotations

from agents.action_inference.observation import Holder, ObservedThing, Snapshot
from dsr.math3d.transforms import Pose
from dsr.perception.scales import STEADY
from dsr.vocabulary.observed_actions import UNKNOWN

REMEMBERED = STEADY
"""s for which it is known where a hand was"""


class Attribution:
    """Remembers where hands were.

    Args:
        reach: m between a hand and the surface of a thing up to which it may hold it.
    """

    def __init__(self, reach: float) -> None:
        self._reach = reach
        self._seen: list[tuple[float, dict[str, Holder]]] = []

    def update(self, snapshot: Snapshot) -> None:
        """Take note of where hands and grippers are."""
        perceived = {name: holder for name, holder in snapshot.holders.items() if holder.perceived}
        self._seen = [entry for entry in self._seen if entry[0] >= snapshot.now - REMEMBERED] + [
            (snapshot.now, perceived)
        ]

    def palm_height(self, name: str, time: float) -> float | None:
        """World z (m) of a hand's palm at `time` (s), of the last moments; None if it was not seen then."""
        _, holders = min(self._seen, key=lambda entry: abs(entry[0] - time), default=(0.0, {}))
        return holders[name].points[0][2] if name in holders else None

    def nearest(self, thing: ObservedThing, pose: Pose, time: float) -> str:
        """Name of the hand that was nearest to the thing at `pose` around `time` (s), within reach; `UNKNOWN` if there
        was none.
        """
        _, holders = min(self._seen, key=lambda entry: abs(entry[0] - time), default=(0.0, {}))
        distances = {
            name: min(thing.distance(point, pose) for point in holder.points) for name, holder in holders.items()
        }
        near = {name: distance for name, distance in distances.items() if distance <= self._reach}
        return min(near, key=lambda name: (near[name], name), default=UNKNOWN)
