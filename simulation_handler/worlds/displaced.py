"""How probable it is that things which are seen displaced are where the simulation has them: did a camera move?"""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose
from dsr.perception.consensus import tells_rotation
from dsr.perception.scales import ONE_MOMENT
from simulation_handler.perception.bumped import Displacement, MovedThing, judge
from simulation_handler.scales import PLACE_FLOOR
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence


class Staying(NamedTuple):
    """How probable it is that a thing is where the simulation has it, though it may be seen elsewhere."""

    probability: float
    """1, probability of that"""
    camera: str = ""
    """Name of the camera that shows the thing; empty if that is not known"""
    by_camera: float = 0.0
    """1, probability that the thing is there and the camera moved"""


def staying(evidence: Evidence, moved: MovedThing) -> dict[str, Staying]:
    """Which things are where the simulation has them, of all that are seen displaced, or by doubted cameras.

    All that one camera alone has shown at the same time tells of that camera. Things of which that is not known are
    left out.

    Args:
        evidence: of this moment.
        moved: how far things get that somebody moves.
    """
    shown: dict[str, dict[str, Pose]] = {}
    for name, thing in evidence.objects.items():
        if thing.percept is not None and len(thing.seen_by) == 1 and _may_tell(thing):
            shown.setdefault(min(thing.seen_by), {})[name] = thing.percept
    found: dict[str, Staying] = {}
    for camera, percepts in shown.items():
        newest = max(percept.stamp for percept in percepts.values())
        told = {name: evidence.objects[name] for name, one in percepts.items() if newest - one.stamp <= ONE_MOMENT}
        if any(thing.is_moving or thing.is_doubted for thing in told.values()):
            found |= _judged(camera, told, evidence.objects.keys(), moved)
    return found


def is_led(thing: ObjectEvidence) -> bool:
    """Whether something is known that moves an object."""
    led = thing.driven or thing.rides or thing.hovers
    return bool(led or thing.hand or thing.gripper or thing.touched_by)


def _may_tell(thing: ObjectEvidence) -> bool:
    """Whether an object is seen, and nothing is known that moves it."""
    is_known = thing.believed is not None and thing.believed.cov is not None and thing.seen_from is not None
    return thing.is_recognised and is_known and not is_led(thing)


def _judged(
    camera: str, told: Mapping[str, ObjectEvidence], objects: Set[str], moved: MovedThing
) -> dict[str, Staying]:
    """What `camera` shows at one moment, which is `told` of; `objects` may carry what it shows."""
    loads = [name for name, thing in told.items() if thing.containers or not objects.isdisjoint(thing.supports)]
    things = [name for name in told if name not in loads]
    if not things:
        return {}
    asked, others = ([_displacement(told[name]) for name in names] for names in (things, loads))
    verdict = judge(asked, others, moved)
    told_of = zip([*things, *loads], verdict.stays.tolist(), verdict.shown_elsewhere.tolist(), strict=True)
    return {name: Staying(stays, camera, elsewhere) for name, stays, elsewhere in told_of}


def _displacement(thing: ObjectEvidence) -> Displacement:
    """How far a thing is seen from where it is believed to be."""
    percept, believed, eye = thing.percept, thing.believed, thing.seen_from
    assert percept is not None and believed is not None and eye is not None
    (place, turning), (own_place, own_turning) = believed.parent_covariances(), percept.parent_covariances()
    x, y, z = np.subtract(believed.t, eye).tolist()
    turn = None
    if tells_rotation(own_turning):
        turn = np.array(quaternions.to_rotvec(quaternions.product(percept.q, quaternions.conjugate(believed.q))))
    floor = PLACE_FLOOR**2 * np.eye(3)
    return Displacement(
        np.subtract(percept.t, believed.t), place + own_place + floor, turn, turning + own_turning, (x, y, z)
    )
