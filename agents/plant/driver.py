"""Drivers for the simulated arm and cameras, by which the agents talk to them (see agents/drivers.py)."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Generic, TypeVar

import msgspec

from agents.drivers import ArmState, HandReadings, PersonReadings, TagReadings
from agents.plant.messages import (
    Command,
    Follow,
    KeepAlive,
    MoveGripper,
    Stop,
    arm_command_key,
    arm_state_key,
    decode_arm_state,
    decode_hand_readings,
    decode_person_readings,
    decode_tag_readings,
    frame_key,
    hands_key,
    persons_key,
    readings_key,
)
from dsr.errors import WireError
from dsr.images.blobs import Frame
from dsr.images.frame_reader import FrameReader
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Transport
from dsr.vocabulary.arms import ARM

log = logging.getLogger("agents.plant.driver")

T = TypeVar("T")


class NewestSample(Generic[T]):
    """The newest message on a key; those that cannot be decoded are counted and dropped."""

    def __init__(self, bus: Transport, key: str, decode: Callable[[bytes], T]) -> None:
        self._key = key
        self._decode = decode
        self._payload: bytes | None = None
        self.arrived: Callable[[], object] = lambda: None
        """Called in the thread of the transport when there is a new message"""
        self.dropped = 0
        """Messages that could not be decoded."""
        self._subscription = bus.subscribe(key, self._keep, newest=1)

    def take(self) -> T | None:
        """The newest message if there is one since the last call."""
        payload, self._payload = self._payload, None
        if payload is None:
            return None
        try:
            return self._decode(payload)
        except WireError as error:
            if self.dropped == 0:
                log.warning("message on %s dropped (logged once): %s", self._key, error)
            self.dropped += 1
            return None

    def close(self) -> None:
        """Stop listening."""
        self._subscription.close()

    def _keep(self, key: str, payload: bytes) -> None:
        self._payload = payload
        self.arrived()


class PlantArm:
    """A simulated arm, an `ArmDriver` that announces its samples.

    Args:
        bus: where the plant is heard.
        keys: of the plant's graph.
        arm: its name in the scenario; `arm` for that of `[robot]`.
    """

    def __init__(self, bus: Transport, keys: Keys, arm: str = ARM) -> None:
        self._bus = bus
        self._key = arm_command_key(keys, arm)
        self._states = NewestSample(bus, arm_state_key(keys, arm), decode_arm_state)
        self._state: ArmState | None = None

    def state(self) -> ArmState | None:
        """The newest sample, or None before the first."""
        self._state = self._states.take() or self._state
        return self._state

    def on_sample(self, call: Callable[[], object]) -> None:
        """Call this, in any thread, at each new sample."""
        self._states.arrived = call

    def follow(self, times: tuple[float, ...], positions: tuple[tuple[float, ...], ...]) -> None:
        """Pass through joint `positions` (rad) at `times` (s from now, increasing), and stay at the last ones."""
        self._send(Follow(times, positions))

    def move_gripper(self, opening: float) -> None:
        """Open or close to `opening` m between the pads."""
        self._send(MoveGripper(opening))

    def stop(self) -> None:
        """Come to rest at once, within the joints' limits."""
        self._send(Stop())

    def keep_alive(self) -> None:
        """Tell the plant that the controller lives; without that for a while, it stops the arm by itself."""
        self._bus.publish(self._key, msgspec.msgpack.encode(KeepAlive()), Qos.STREAM)

    def close(self) -> None:
        """Stop listening."""
        self._states.close()

    def _send(self, command: Command) -> None:
        self._bus.publish(self._key, msgspec.msgpack.encode(command), Qos.RELIABLE)


class PlantCamera:
    """A simulated camera, a `CameraDriver`.

    Args:
        bus: where the plant is heard.
        keys: of the plant's graph.
        name: `overhead` or `wrist`.
    """

    def __init__(self, bus: Transport, keys: Keys, name: str = "overhead") -> None:
        self._frames = FrameReader(bus, frame_key(keys, name))

    def frame(self) -> Frame | None:
        """The newest frame if it was not returned before, else None."""
        return self._frames.latest()

    def close(self) -> None:
        """Stop listening."""
        self._frames.close()


class PlantPoses:
    """A simulated camera that tells poses of tags instead of images; arguments as of `PlantCamera`."""

    def __init__(self, bus: Transport, keys: Keys, name: str = "overhead") -> None:
        self._readings = NewestSample(bus, readings_key(keys, name), decode_tag_readings)

    def readings(self) -> TagReadings | None:
        """The newest readings if they were not returned before, else None."""
        return self._readings.take()

    def close(self) -> None:
        """Stop listening."""
        self._readings.close()


class PlantHands:
    """A simulated camera that tells hand landmarks instead of images, a `HandDriver`; arguments as of `PlantCamera`."""

    def __init__(self, bus: Transport, keys: Keys, name: str = "overhead") -> None:
        self._readings = NewestSample(bus, hands_key(keys, name), decode_hand_readings)

    def readings(self) -> HandReadings | None:
        """The newest readings if they were not returned before, else None."""
        return self._readings.take()

    def close(self) -> None:
        """Stop listening."""
        self._readings.close()


class PlantPersons:
    """A simulated tracker of persons, a `PersonDriver`.

    Args:
        bus: where the plant is heard.
        keys: of the plant's graph.
    """

    def __init__(self, bus: Transport, keys: Keys) -> None:
        self._readings = NewestSample(bus, persons_key(keys), decode_person_readings)

    def readings(self) -> PersonReadings | None:
        """The newest readings if they were not returned before, else None."""
        return self._readings.take()

    def close(self) -> None:
        """Stop listening."""
        self._readings.close()
