"""The hypothesis that a camera moved: which objects it would explain, and how they would be seen without that."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.batches import rigid_fit
from dsr.math3d.quaternions import Quaternion
from dsr.perception.consensus import tells_rotation
from dsr.perception.scales import ONE_MOMENT, SAME_PLACE
from dsr.vocabulary import nats
from simulation_handler.contact.supports import MOST_COMBINED
from simulation_handler.explaining.hypotheses import Hypothesis
from simulation_handler.explaining.situation import Seen, Situation
from simulation_handler.perception.percepts import Array
from simulation_handler.scales import GONE_FROM, PLACE_FLOOR, TURN_FLOOR
from simulation_handler.shapes.geometry import Solid

FEWEST = 2
"""Objects that must be explained by one motion of the camera, for that to be told from moved objects."""

_ARM = PLACE_FLOOR / TURN_FLOOR  # m: an object's rotation counts as much as points that far from its centre
_NEARLY = GONE_FROM + SAME_PLACE
"""m, up to which an object may be where a motion has it: from farther it has left, and the guess by one may be off"""
_TURNED = _NEARLY / _ARM  # rad up to which it is turned as that motion would have it


def explained_by_camera(situation: Situation) -> frozenset[str]:
    """The objects that are seen displaced, or not, as one motion of the camera would have it: the least of them.

    Empty if those are fewer than `FEWEST` or not most of all that are seen. Objects that agreed with each other on
    one motion are no guess of another: a group that is as large as theirs has somebody else in it.
    """
    names, found = comparable(situation), [frozenset[str]()]
    for few in _guesses(situation, names) if len(names) >= FEWEST else ():
        if any(group.issuperset(few) for group in found):
            continue
        found.append(_consensus(situation, names, _motion(situation, few)))
        if len(found[-1]) == len(names):
            break
    best = min(found, key=lambda group: (-len(group), _displacement(situation, group)))
    enough = len(best) >= FEWEST and 2 * len(best) > len(names)
    return best if enough else frozenset()


def corrected(situation: Situation, hypothesis: Hypothesis) -> Situation:
    """Predict the situation as it would be seen if the camera had not moved.

    If the hypothesis does not move the camera, this is the situation itself.

    The motion of the camera is the one that explains best what the hypothesis does not explain otherwise.
    """
    if not hypothesis.camera_moved:
        return situation
    fresh = _fresh(situation)
    names = [n for n in comparable(situation) if n not in hypothesis.moved and n not in hypothesis.kept]
    if not names:
        return situation
    rotation, shift = _motion(situation, names)
    carried = {name: _carried(situation.seen[name], situation, rotation, shift) for name in fresh}
    return replace(situation, seen={**situation.seen, **carried})


def comparable(situation: Situation) -> list[str]:
    """Objects that are believed somewhere, and seen just now by a camera that may have moved.

    Older percepts may be from before it moved.
    """
    return sorted(_fresh(situation) & situation.believed.keys())


def _fresh(situation: Situation) -> set[str]:
    latest = min((seen.age for seen in situation.seen.values()), default=0.0)
    fresh = {name for name, seen in situation.seen.items() if seen.age - latest <= ONE_MOMENT}
    return fresh - situation.sure


def _guesses(situation: Situation, names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Objects from which the motion of the camera can be guessed: single ones, and three where those tell no rotation.

    A single place tells how the camera is shifted, but not how it is turned; as many as space has dimensions tell both.
    """
    yield from ((name,) for name in names)
    turned = [name for name in names if not _tells_rotation(situation, name)]
    far = sorted(turned, key=lambda name: (-_displacement(situation, [name]), name))
    if far:
        dimensions = len(situation.believed[far[0]].position)
        yield from combinations(far[:MOST_COMBINED], dimensions)


def _consensus(situation: Situation, names: Sequence[str], motion: tuple[Array, Array]) -> frozenset[str]:
    """The objects that agree with a motion like this one: looked for roughly first, then closely."""
    rotation, shift = motion
    agreeing = frozenset(name for name in names if _may_agree(situation, name, rotation, shift))
    tried: set[frozenset[str]] = set()
    while agreeing not in tried:
        if len(agreeing) < FEWEST:
            return frozenset()
        tried.add(agreeing)
        rotation, shift = _motion(situation, sorted(agreeing))
        agreeing = frozenset(n for n in names if _agrees(situation, n, rotation, shift))
    return agreeing


def _displacement(situation: Situation, names: Collection[str]) -> float:
    """How far (m), on average, these objects seem to have moved because the camera did."""
    apart = [math.dist(situation.seen[name].shown.position, situation.believed[name].position) for name in names]
    return sum(apart) / len(apart) if apart else 0.0


def _motion(situation: Situation, names: Collection[str]) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) that bring what is seen closest to what is believed."""
    seen = np.concatenate([_points(situation.seen[n].shown, _tells_rotation(situation, n)) for n in names])
    believed = np.concatenate([_points(situation.believed[n], _tells_rotation(situation, n)) for n in names])
    return rigid_fit(seen, believed)


def _points(solid: Solid, has_rotation: bool) -> Array:
    """(7, 3) m: the centre, and points around it that turn with the object."""
    around = _ARM * np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    turned = around @ np.transpose(quaternions.to_matrix(solid.rotation)) if has_rotation else np.zeros((7, 3))
    result: Array = np.array(solid.position) + turned
    return result


def _tells_rotation(situation: Situation, name: str) -> bool:
    return tells_rotation(situation.seen[name].turning)


def _may_agree(situation: Situation, name: str, rotation: Array, shift: Array) -> bool:
    """Whether an object is about where a motion that was guessed from a single object would have it."""
    shown, believed = situation.seen[name].shown, situation.believed[name]
    position, turned = _moved(shown, rotation, shift)
    if math.dist(position, believed.position) <= _NEARLY:
        turn = quaternions.to_rotvec(quaternions.product(turned, quaternions.conjugate(believed.rotation)))
        if math.hypot(*turn) < _TURNED or not _tells_rotation(situation, name):
            return True
    return _agrees(situation, name, rotation, shift)


def _agrees(situation: Situation, name: str, rotation: Array, shift: Array) -> bool:
    """Whether an object is where a motion would have it, but for noise."""
    seen, believed = situation.seen[name], situation.believed[name]
    apart = math.dist(_moved(seen.shown, rotation, shift)[0], believed.position)
    if 0.5 * apart**2 >= nats.SURPRISING * seen.covariance.trace():  # no direction is less certain than all together
        return False
    return _carried(seen, situation, rotation, shift).misfit(believed) < nats.SURPRISING


def _carried(seen: Seen, situation: Situation, rotation: Array, shift: Array) -> Seen:
    """The percept as it would be from where the camera was."""
    position, turned = _moved(seen.shown, rotation, shift)
    shown = seen.percept.at(position, turned)
    flat, tilt = shown.face_down()
    percept = flat if tilt <= situation.config.tilt_tolerance else shown
    return replace(seen, percept=percept, unflattened=shown)


def _moved(solid: Solid, rotation: Array, shift: Array) -> tuple[tuple[float, float, float], Quaternion]:
    x, y, z = (rotation @ np.array(solid.position) + shift).tolist()
    return (x, y, z), quaternions.product(quaternions.from_matrix(rotation.tolist()), solid.rotation)
