"""Persons in the true world: where their eyes are and where they look, and a tracker that tells that with errors.

They have no bodies: what they do to things is done by hands, and nothing is hidden by them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from agents.drivers import PersonReading, PersonReadings
from agents.scenario.format.scenario import PersonSpec
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

SIGMA_TRANSLATION = 0.005
"""m, standard deviation of each coordinate of the eyes"""
SIGMA_ROTATION = math.radians(1.0)
"""rad, about each axis, of the gaze"""


class Person:
    """One person."""

    def __init__(self, spec: PersonSpec) -> None:
        self.spec = spec
        self.name = spec.name
        self.is_present = spec.present
        """In the scene at all."""
        self.pose = gaze(spec.position, spec.look_at)
        """world_from_person"""


class Persons:
    """All persons of a scenario."""

    def __init__(self, specs: Iterable[PersonSpec]) -> None:
        self._persons = {spec.name: Person(spec) for spec in specs}

    def __len__(self) -> int:
        return len(self._persons)

    def __getitem__(self, name: str) -> Person:
        return self._persons[name]

    @property
    def present(self) -> list[Person]:
        """The persons in the scene."""
        return [person for person in self._persons.values() if person.is_present]

    def read(self, rng: np.random.Generator, stamp: float) -> PersonReadings:
        """Simulate the tracker's present readings; errors are drawn also for persons who are not there."""
        readings = []
        for person in self._persons.values():
            noise = rng.normal(0.0, 1.0, 6)
            if person.is_present:
                error = Pose.from_rotvec(noise[:3] * SIGMA_TRANSLATION, noise[3:] * SIGMA_ROTATION)
                seen = person.pose @ error
                numbers = (*seen.t, *seen.q)
                readings.append(PersonReading(person.name, numbers, SIGMA_TRANSLATION, SIGMA_ROTATION, person.spec.fov))
        return PersonReadings(stamp, readings)


def gaze(position: Vector3, look_at: Vector3) -> Pose:
    """world_from_person of somebody whose eyes are at `position` and look at another place (m), the head upright."""
    x, y, z = (there - here for there, here in zip(look_at, position, strict=True))
    yaw, pitch = math.atan2(y, x), math.atan2(-z, math.hypot(x, y))
    turn = quaternions.product(quaternions.from_rotvec((0.0, 0.0, yaw)), quaternions.from_rotvec((0.0, pitch, 0.0)))
    return Pose(position, turn)
