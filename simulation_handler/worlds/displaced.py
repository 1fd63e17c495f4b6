"""How probable it is that things which are seen displaced are where the simulation has them: did a camera move?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose
from dsr.perception.consensus import tells_rotation
from dsr.perception.scales import ONE_MOMENT, STEADY
from simulation_handler.perception.bumped import Displacement, MovedThing, judge
from simulation_handler.scales import GONE_FROM, PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence


class Staying(NamedTuple):
    """How probable it is that a thing is where the simulation has it, though it may be seen elsewhere."""

    probability: float
    """1, probability of that"""
    camera: str = ""
    """Name of the camera that shows the thing; empty if that is not known"""
    by_camera: float = 0.0
    """1, probability that the thing is there and the camera moved"""


class Former(NamedTuple):
    """Where a thing was before the simulation followed what is seen of it."""

    stays: Staying
    """Whether it is there yet, because its camera moved"""
    pose: Pose
    """world_from_object, with covariance"""


class StayingOverTime:
    """Whether one thing is where the simulation has it, or had it before it followed what is seen, over time."""

    def __init__(self) -> None:
        self.stays: Staying | None = None
        """Whether it is where the simulation has it though it is seen displaced; None while it is not"""
        self.by_camera = 0.0
        """1, probability that its camera has moved, and it is there; or, while driven, that it is where it set out"""
        self._former: Former | None = None
        self._before: ObjectEvidence | None = None
        self._relearned = -math.inf
        """s, when its camera was last told to be elsewhere; while it is seen displaced since then, that goes on"""

    def note(self, thing: ObjectEvidence, stays: Staying | None, now: float) -> float:
        """Take in the thing at `now` (s), while it is recognised, and how probable it is that it stays.

        Args:
            thing: the thing.
            stays: as of `staying`. What is not known of it now was known before.
            now: s

        Returns:
            The probability that it is where the simulation has it though it is seen displaced; 0 if it is not.
        """
        before, self._before = self._before, thing
        is_relearned = before is not None and before.seen_from != thing.seen_from
        is_off = thing.is_moving or thing.is_doubted
        if is_relearned or (is_off and now - self._relearned <= STEADY):
            self._relearned = now
        rather = self.rather_at
        if before is None or is_relearned or thing.is_sure:
            self._former = None  # it is known better where its camera is
        elif is_led(thing):
            self._former = None  # it has moved since
        elif rather is not None:
            self._former = Former(stays, rather) if stays else self._former
        elif thing.set_out_from is not None:
            self._former = self._set_out(Former(stays, thing.set_out_from)) if stays else self._former
        elif before.believed and thing.believed and before.believed.distance(thing.believed)[0] > PLACE_FLOOR:
            self._former = self._left(before.believed, thing.believed)
        if thing.driven or not is_off or rather is not None:
            self.stays = None
        elif thing.is_sure or thing.rides or now - self._relearned <= STEADY:
            self.stays = Staying(float(thing.is_doubted))
        else:
            self.stays = stays or self.stays or Staying(float(thing.is_doubted))
        told = self._former.stays if self._former and (rather or thing.driven) else self.stays
        self.by_camera = 0.0 if told is None else told.by_camera
        return 0.0 if self.stays is None else self.stays.probability

    @property
    def rather_at(self) -> Pose | None:
        """World_from_object where it was before, if it rather is there yet: what is seen is compared with that."""
        former = self._former
        return former.pose if former and former.stays.by_camera > 1.0 - former.stays.by_camera else None

    @property
    def former(self) -> Former | None:
        """Where it was before the simulation followed what is seen, and still is if the camera moved.

        If it is not where the simulation has it because it has moved again, it is not there, either.
        """
        if self._former is None or self.stays is None:
            return self._former
        chance = self._former.stays.by_camera * self.stays.probability
        return Former(Staying(chance, self._former.stays.camera, chance), self._former.pose)

    def _set_out(self, new: Former) -> Former:
        """Where it may be yet, now that it is driven from a new place: there or where it was before, as is likelier."""
        former = self._former
        if former and former.pose.distance(new.pose)[0] > PLACE_FLOOR and former.stays.by_camera > new.stays.by_camera:
            return former
        return new

    def _left(self, place: Pose, new: Pose) -> Former | None:
        """Where it may be yet, once the simulation has left a place for a new one: there, or where it was before."""
        stays, before, former = self.stays, self._former, self.former
        if stays is None:
            return None if place.distance(new)[0] > GONE_FROM else former
        if before and former and former.stays.by_camera >= (1.0 - before.stays.by_camera) * stays.by_camera:
            return former
        return Former(stays, place)


def staying(evidence: Evidence, moved: MovedThing, rather_at: Mapping[str, Pose] | None = None) -> dict[str, Staying]:
    """Which things are where the simulation has them, of all that are seen displaced, or by doubted cameras.

    All that one camera alone has shown at the same time tells of that camera. Things of which that is not known are
    left out.

    Args:
        evidence: of this moment.
        moved: how far things get that somebody moves.
        rather_at: world_from_object of those that rather are still where they were before the simulation followed.
    """
    rather_at = rather_at or {}
    before = {
        name: rather_at.get(name) or thing.set_out_from or thing.believed for name, thing in evidence.objects.items()
    }
    shown: dict[str, dict[str, Pose]] = {}
    for name, thing in evidence.objects.items():
        if thing.percept is not None and len(thing.seen_by) == 1 and _may_tell(thing, before[name]):
            shown.setdefault(min(thing.seen_by), {})[name] = thing.percept
    missing = [thing.solid for thing in evidence.objects.values() if thing.is_missing and thing.solid is not None]
    found: dict[str, Staying] = {}
    for camera, percepts in shown.items():
        newest = max(percept.stamp for percept in percepts.values())
        told = {name: evidence.objects[name] for name, one in percepts.items() if newest - one.stamp <= ONE_MOMENT}
        asked = (thing.is_moving or thing.is_doubted or before[n] is not thing.believed for n, thing in told.items())
        if any(asked):
            found |= _judged(camera, told, before, moved, missing)
    return found


def is_led(thing: ObjectEvidence) -> bool:
    """Whether something is known that moves an object, and not just its way."""
    led = (thing.driven and thing.set_out_from is None) or thing.rides
    return bool(led or thing.hand or thing.gripper or thing.touched_by)


def _may_tell(thing: ObjectEvidence, before: Pose | None) -> bool:
    """Whether an object is seen, and neither is it known that its camera stands, nor anything that moves it."""
    is_known = before is not None and before.cov is not None and thing.seen_from is not None
    return thing.is_recognised and is_known and not (is_led(thing) or thing.hovers or thing.is_sure)


def _judged(
    camera: str, told: Mapping[str, ObjectEvidence], before: Mapping[str, Pose | None], moved: MovedThing,
    missing: Sequence[Solid],
) -> dict[str, Staying]:  # fmt: skip
    """What `camera` shows of things, which is `told`, if all were there `before`, beside what is `missing`."""
    loads = [name for name, thing in told.items() if thing.containers or not before.keys().isdisjoint(thing.supports)]
    things = [name for name in told if name not in loads]
    if not things:
        return {}
    asked, others = (
        [_displacement(told[name], before[name], missing) for name in names] for names in (things, loads)
    )
    verdict = judge(asked, others, moved)
    told_of = zip([*things, *loads], verdict.stays.tolist(), verdict.shown_elsewhere.tolist(), strict=True)
    return {name: Staying(stays, camera, elsewhere) for name, stays, elsewhere in told_of}


def _displacement(thing: ObjectEvidence, before: Pose | None, missing: Sequence[Solid]) -> Displacement:
    """How far a thing is seen from where it was before, beside what is `missing`."""
    percept, eye = thing.percept, thing.seen_from
    assert percept is not None and before is not None and eye is not None
    (place, turning), (own_place, own_turning) = before.parent_covariances(), percept.parent_covariances()
    x, y, z = np.subtract(before.t, eye).tolist()
    turn = None
    if tells_rotation(own_turning):
        turn = np.array(quaternions.to_rotvec(quaternions.product(percept.q, quaternions.conjugate(before.q))))
    floor = PLACE_FLOOR**2 * np.eye(3)
    shift, covariance = np.subtract(percept.t, before.t), place + own_place + floor
    radius = 0.0 if thing.solid is None else thing.solid.radius
    is_disturbed = thing.near_hand or any(math.dist(before.t, one.position) < one.radius + radius for one in missing)
    return Displacement(shift, covariance, turn, turning + own_turning, (x, y, z), is_disturbed, thing.by_way)
