"""Writes the hands that the cameras see: nodes of palms and fingertips with their poses in the world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import NamedTuple

import numpy as np

from agents.drivers import HandDriver, HandReading, HandReadings, make_driver
from agents.hand_tracker.config import HandSensor, HandTrackerConfig
from agents.hand_tracker.landmarker import ModelFinder
from agents.hand_tracker.model.files import HOW_TO_GET
from agents.hand_tracker.model.found import FAILURES, Landmarker
from agents.hand_tracker.model.loading import load_landmarker, wants_model
from agents.hand_tracker.nodes import HandNodes
from agents.hand_tracker.sighting import Array, Finder, SeenHand, Source, hand_of_landmarks
from agents.hand_tracker.skin import SkinFinder
from agents.hand_tracker.tracks import Tracks
from agents.stillness import stood_still
from dsr.agent import Access, Agent
from dsr.errors import ConfigError, TransformError, WireError
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose
from dsr.perception.scales import TICK_RATE


class _Look(NamedTuple):
    """What one camera shows."""

    camera: str
    stamp: float
    source: Source
    hands: list[SeenHand]


class HandTracker(Agent):
    """Finds hands in the frames of all cameras that have any, follows two of them and writes them as nodes.

    The real model finds them if it was fetched, else skin colour and depth. If the model is wanted and cannot be used,
    the tracker is `degraded` and does without.
    """

    name = "hand_tracker"
    rate_hz = TICK_RATE
    reads = Access(
        nodes=("world", "camera", "table", "hand", "finger"),
        edges=("RT", "has", "grasping"),
        attributes=("perceived", "last_seen", "side", "source", "size"),
    )
    writes = Access(
        nodes=("hand", "finger"),
        edges=("RT", "has"),
        attributes=("perceived", "last_seen", "side", "source", "size"),
        exclusive=("finger",),  # of hands, `surprise` writes how improbable their motions are
    )
    Config = HandTrackerConfig
    config: HandTrackerConfig

    def setup(self) -> None:
        """Listen to the cameras. Raises `ConfigError` for a driver that cannot be made."""
        config = self.config
        self.skipped: Counter[str] = Counter()
        """Frames that were not used, by reason."""
        self._closing = ExitStack()
        take = self._closing.enter_context
        self._tracks = Tracks(config)
        self._nodes = HandNodes(self.memory, config)
        self._adopted = False
        self._finders: dict[str, Finder] = {}
        self._make_landmarker: Callable[[], Landmarker] | None = None
        self._why_not = ""
        if wants_model(config):
            try:
                self._make_landmarker = load_landmarker(config)
            except ConfigError as error:
                self._why_not = str(error)
        self._say_how()
        self._streams = {camera: take(closing(self.memory.frames(camera))) for camera in config.cameras}
        self._sensors = {camera: take(closing(self._driver(sensor))) for camera, sensor in config.hand_sensors.items()}

    def tick(self, now: float) -> None:
        """Look at each camera's newest frame, then at who was not seen for long."""
        if not self._adopted:
            for track in self._nodes.known():
                self._tracks.adopt(track)
            self._adopted = True
        with self.memory.batch():
            for look in self._look():
                self._follow(look, now)
            for number in self._nodes.age(now):
                self._tracks.forget(number)

    def teardown(self) -> None:
        """Stop listening and release the model."""
        for finder in self._finders.values():
            finder.close()
        self._closing.close()

    def _driver(self, sensor: HandSensor) -> HandDriver:
        driver: HandDriver = make_driver(sensor.driver, self.bus, self.keys, **sensor.options)
        return driver

    def _look(self) -> Iterator[_Look]:
        """Everything new."""
        for camera, stream in self._streams.items():
            frame = stream.latest()
            if frame is None or not self._stood_still(camera, frame.stamp):
                continue
            if (look := self._read(camera, frame)) is not None:
                yield look
        for camera, sensor in self._sensors.items():
            readings = sensor.readings()
            if readings is not None and self._stood_still(camera, readings.stamp):
                yield _Look(camera, readings.stamp, "poses", read_sensor(readings))

    def _stood_still(self, camera: str, stamp: float) -> bool:
        """Else its images are blurred, and its pose is not known well enough to say where a hand is."""
        still = stood_still(self.memory, camera, stamp, self.config.max_camera_speed, self.config.max_camera_turn)
        if not still:
            self._skip("camera moved", f"{camera} moved, or its pose is not known then")
        return still

    def _read(self, camera: str, frame: Frame) -> _Look | None:
        finder = self._finder(camera)
        try:
            try:
                hands = finder.find(frame, self._table(camera, frame.stamp))
            except FAILURES as error:
                if not isinstance(finder, ModelFinder):
                    raise
                self._degrade(f"the model failed: {error}")
                finder = self._finder(camera)
                hands = finder.find(frame, self._table(camera, frame.stamp))
        except WireError as error:
            self._skip("malformed", f"{camera}: {error}")
            return None
        return _Look(camera, frame.stamp, finder.source, hands)

    def _finder(self, camera: str) -> Finder:
        """That of a camera: the model follows one stream of images each."""
        if camera not in self._finders:
            self._finders[camera] = self._make_finder()
        return self._finders[camera]

    def _make_finder(self) -> Finder:
        if self._make_landmarker is not None:
            try:
                return ModelFinder(self.config, self._make_landmarker())
            except ConfigError as error:
                self._why_not = str(error)
        if self._why_not:
            self._degrade(self._why_not)
        return SkinFinder(self.config)

    def _say_how(self) -> None:
        """Tell in the log how hands are found in images; what is wrong is told when images come."""
        if self._make_landmarker is not None:
            self.log.info("hands are found by the model, run by %s", self.config.runner)
        elif not self._why_not:
            why = "as configured" if self.config.finder == "colour" else f"the model was not fetched; {HOW_TO_GET}"
            self.log.info("hands are found by skin colour and depth: %s", why)

    def _degrade(self, why: str) -> None:
        """Go on with skin colour and depth, and say so once."""
        if not self.degraded:
            self.log.warning("hands are found by skin colour and depth only: %s", why)
        self.degraded = f"skin colour and depth only: {why}"
        self._make_landmarker, self._why_not = None, why
        for camera, finder in list(self._finders.items()):
            if isinstance(finder, ModelFinder):
                finder.close()
                del self._finders[camera]

    def _follow(self, look: _Look, now: float) -> None:
        """Take in what a camera shows."""
        try:
            world_from_camera = self.memory.transform("world", look.camera, at=look.stamp)
        except TransformError as error:
            self._skip("camera not placed", f"{look.camera}: {error}")
            return
        stamp = min(look.stamp, now)  # a camera whose clock is ahead sees it now, not later
        seen = [in_world(hand, world_from_camera, stamp) for hand in look.hands]
        taken = {number: track.last_seen for number, track in self._tracks.by_number.items()}
        for number in self._tracks.update(seen, look.source, stamp):
            if number in taken:
                self._nodes.remove(number)
            taken.pop(number, None)
        for number, track in self._tracks.by_number.items():
            if track.last_seen != taken.get(number):
                self._nodes.write(track, now)

    def _table(self, camera: str, stamp: float) -> Array | None:
        """The plane (4,) of the table's top in the camera's frame, pointing up; None without a table."""
        tables = self.memory.nodes("table")
        if not tables:
            return None
        camera_from_table = self.memory.get_transform(camera, tables[0].name, at=stamp)
        if camera_from_table is None:
            return None
        up = camera_from_table.rotation_matrix[:, 2]
        return np.array([*up, -float(up @ camera_from_table.translation)])

    def _skip(self, reason: str, detail: str) -> None:
        self.skipped[reason] += 1
        if self.skipped[reason] == 1:
            self.log.warning("frame skipped: %s (further ones are only counted)", detail)


def read_sensor(readings: HandReadings) -> list[SeenHand]:
    """The hands of a sensor, in the camera's frame."""
    found = (_read_hand(reading) for reading in readings.hands)
    return [hand for hand in found if hand is not None]


def _read_hand(reading: HandReading) -> SeenHand | None:
    return hand_of_landmarks(np.array(reading.landmarks), np.array(reading.visible), reading.side, reading.sigma)


def in_world(hand: SeenHand, world_from_camera: Pose, stamp: float) -> SeenHand:
    """The hand in the world, with its time."""
    palm = (world_from_camera @ hand.palm).with_stamp(stamp).with_covariance(None)
    tips = {finger: world_from_camera.apply(tip[None])[0] for finger, tip in hand.tips.items()}
    turn = world_from_camera.rotation_matrix
    covariance = None if hand.turn_covariance is None else turn @ hand.turn_covariance @ turn.T
    outlined = tuple(tip._replace(point=world_from_camera.apply(tip.point[None])[0]) for tip in hand.outlined)
    return hand._replace(palm=palm, tips=tips, turn_covariance=covariance, outlined=outlined)
