"""Writes the persons that a tracker of heads or gazes tells of: nodes with their poses."""

from __future__ import annotations

import math
from collections import Counter
from typing import Annotated, Any

import msgspec
import numpy as np

from agents.drivers import PersonDriver, PersonReading, make_driver
from dsr.agent import Access, Agent
from dsr.errors import SchemaError
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose, interpolate
from dsr.perception.scales import TICK_RATE
from dsr.visibility import PERSON
from dsr.vocabulary.perceived import seconds_unseen

_LEAST = 1e-4  # m and rad, of a standard deviation
_MOVES = 5.0  # standard deviations, by which a reading is off if the person moves


class PersonTrackerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The source of the readings, and for how long they count."""

    driver: str = "agents.plant.driver:PlantPersons"
    """`module:Class` of a `PersonDriver`."""
    options: dict[str, Any] = {}
    """Passed to the driver."""
    frame: str = "world"
    """Node in whose frame the tracker tells poses."""
    smoothing: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.15
    """Weight of a new reading of somebody who does not move"""
    max_age: Annotated[float, msgspec.Meta(gt=0)] = 0.5
    """s after which a person that was not seen again is not `perceived` any more"""


class PersonTracker(Agent):
    """Keeps nodes of type `person` in step with a tracker. Who is gone keeps the node, with `perceived` false."""

    name = "person_tracker"
    rate_hz = TICK_RATE
    reads = Access(nodes=(PERSON, "world"), edges=("RT",), attributes=("perceived", "last_seen", "fov"))
    writes = Access(nodes=(PERSON,), edges=("RT",), attributes=("perceived", "last_seen", "fov"), exclusive=(PERSON,))
    Config = PersonTrackerConfig
    config: PersonTrackerConfig

    def setup(self) -> None:
        """Listen to the tracker. Raises `ConfigError` for a driver that cannot be made."""
        self.skipped: Counter[str] = Counter()
        """Readings that were not used, by reason."""
        driver: PersonDriver = make_driver(self.config.driver, self.bus, self.keys, **self.config.options)
        self._driver = driver

    def tick(self, now: float) -> None:
        """Write who was seen, and who is not seen any more."""
        readings = self._driver.readings()
        with self.memory.batch():
            if readings is not None and self.config.frame in self.memory:
                for reading in readings.persons:
                    self._take(reading, min(readings.stamp, now))
            for node in self.memory.nodes(PERSON):
                unseen = seconds_unseen(node, now) if "last_seen" in node else math.inf
                if node.get("perceived") and unseen > self.config.max_age:
                    self.memory.update_node(node.name, perceived=False)

    def teardown(self) -> None:
        """Stop listening."""
        if hasattr(self, "_driver"):
            self._driver.close()

    def _take(self, reading: PersonReading, stamp: float) -> None:
        told: dict[str, Any] = {"perceived": True, "last_seen": stamp}
        if reading.fov is not None and min(reading.fov) > 0.0:
            told["fov"] = reading.fov
        try:
            node = self.memory.get_node(reading.name)
            if node is None:
                node = self.memory.add_node(reading.name, PERSON, **told)
            elif node.type != PERSON:
                self._skip("taken", f"{reading.name!r} is a node of type {node.type!r}")
                return
            changed = {key: value for key, value in told.items() if node.get(key) != value}
            if changed:
                self.memory.update_node(reading.name, **changed)
            self.memory.add_edge(self.config.frame, reading.name, "RT", pose=self._smoothed(reading, stamp))
        except SchemaError as error:
            self._skip("malformed", str(error))

    def _smoothed(self, reading: PersonReading, stamp: float) -> Pose:
        """frame_from_person with its covariance: between the one before and the reading, unless the person moves."""
        deviations = max(reading.sigma_translation, _LEAST), max(reading.sigma_rotation, _LEAST)
        pose = Pose(reading.pose[:3], reading.pose[3:], stamp)
        edge = self.memory.get_edge(self.config.frame, reading.name, "RT")
        known = None if edge is None else edge.get("pose")
        if known is not None and PoseTolerance(*deviations).scaled(_MOVES).covers(known, pose):
            before = known.with_covariance(None).with_stamp(0.0)
            pose = interpolate(before, pose.with_stamp(1.0), self.config.smoothing).with_stamp(stamp)
        return pose.with_covariance(np.diag(np.square(np.repeat(deviations, 3))))

    def _skip(self, reason: str, detail: str) -> None:
        self.skipped[reason] += 1
        if self.skipped[reason] == 1:
            self.log.warning("person skipped: %s (further ones are only counted)", detail)
