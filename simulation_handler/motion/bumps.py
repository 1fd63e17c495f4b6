"""Which resting things all seem to be displaced at once, as one motion of a camera shows them: that may be the camera.

Each by itself looks like something that somebody moves. Together they are in doubt, and none is driven anywhere: they
are surprising then, and explained.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.camera import FEWEST, explained_by_camera
from simulation_handler.explaining.scoring import is_displaced
from simulation_handler.explaining.situation import Properties, Seen, Situation
from simulation_handler.scales import PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject

_FEWEST_AGREEING = FEWEST + 1
"""Objects that must agree on one motion of the camera: two boxes may be moved so that they do."""


def seem_bumped(
    items: Mapping[str, BelievedObject], rested: Mapping[str, Solid], config: BeliefConfig, now: float
) -> frozenset[str]:
    """The objects whose newest percepts are displaced, or not, as one motion of a camera has it; empty if that is none.

    Args:
        items: the objects by name.
        rested: where those have rested that nothing touches or carries, and that are seen.
        config: tolerances.
        now: s
    """
    seen = {name: _newest(items[name], config, now) for name in rested}
    displaced = {name for name, one in seen.items() if is_displaced(one, rested[name], config)}
    if len(rested) < _FEWEST_AGREEING or len(displaced) < FEWEST:
        return frozenset()
    properties = {name: Properties(items[name].mass, items[name].friction) for name in rested}
    situation = Situation(now, config, {}, rested, properties, seen, surprising=tuple(sorted(displaced)))
    alike = explained_by_camera(situation)
    enough = len(alike) >= _FEWEST_AGREEING and len(alike & displaced) >= FEWEST
    return alike if enough else frozenset()


def _newest(item: BelievedObject, config: BeliefConfig, now: float) -> Seen:
    """What the newest percept alone says: those before may be from before the bump."""
    percept = item.track.trail[-1]
    x, y, z = item.corrected(percept).tolist()
    shown = item.solid((x, y, z), percept.rotation)
    flat, tilt = shown.face_down()
    systematic = item.error_std(config) ** 2 * np.outer(percept.ray, percept.ray)
    covariance = percept.position_covariance + systematic + PLACE_FLOOR**2 * np.eye(3)
    return Seen(
        percept=flat if tilt <= config.tilt_tolerance else shown,
        covariance=covariance,
        turning=percept.rotation_covariance,
        count=1,
        moving=True,
        age=now - percept.stamp,
        unflattened=shown,
    )
