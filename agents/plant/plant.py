"""The agent `plant`: lets the simulated reality run with the clock and connects it to the drivers."""

from __future__ import annotations

import math
from collections import deque

import msgspec

from agents.plant.camera import Exposure, SimulatedCamera
from agents.plant.config import PlantConfig
from agents.plant.messages import (
    arm_command_key,
    arm_state_key,
    decode_command,
    frame_key,
    hands_key,
    persons_key,
    readings_key,
)
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ, STEP
from agents.scenario.format.scenario import load_scenario
from dsr.agent import Agent
from dsr.errors import WireError
from dsr.images.blobs import frame_chunks
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Subscription, Transport
from dsr.vocabulary.halting import HaltLatch, HaltOrder, HaltReport, halt_report_key
from dsr.vocabulary.scenario_start import decode_start, start_key

MOST_STEPS = RATE_HZ // 4
"""Steps in one tick; a plant that is later than that lets its world wait."""
COMPLAINT_PERIOD = 10.0
"""s between two complaints that the machine is too slow."""
_COMMANDS_KEPT = 256
_ROUNDING = 1e-3  # steps; stamps of today are exact to 6e-5 steps


class Plant(Agent):
    """The simulated reality: publishes the data of real drivers, and takes their commands.

    It never reads the working memory. The world runs from the first tick on; the scenario's timeline starts
    with the runner's `Start` message, or at the configured time.
    """

    name = "plant"
    rate_hz = 60.0
    uses_memory = False
    publishes = ("device/*/state", "device/camera/**", "device/persons", "device/halted/*", "truth")
    Config = PlantConfig
    config: PlantConfig

    def setup(self) -> None:
        """Build the world and let the objects settle. Raises `ConfigError`."""
        scenario = load_scenario(self.config.scenario, without_tags=self.config.untagged)
        self._reality = Reality(scenario, self.config, self.seed)
        self._duration = scenario.duration
        self._epoch: float | None = None
        self._steps = 0
        self._start: float | None = self.config.start or None
        self._start_message: bytes | None = None
        self._exposed: deque[tuple[SimulatedCamera, Exposure]] = deque()
        self._arms = {name: _ArmDevice(self.bus, self.keys, name) for name in self._reality.arms}
        self._waited = self._next_complaint = 0.0
        self.dropped = 0
        """Messages that could not be understood."""
        self._state_due, self._truth_due, self._camera_due = (
            _Every(hz) for hz in (self.config.state_hz, self.config.truth_hz, self.config.camera_hz)
        )
        self._subscriptions: list[Subscription] = [
            self.bus.subscribe(start_key(self.keys), self._keep_start),
        ]

    def tick(self, now: float) -> None:
        """Let the world run until `now`, then publish what is due."""
        if self._epoch is None:
            self._epoch = now
            self._replay()
        self._take_start()
        self._take_commands()
        self._obey_halt()
        self._advance(now)
        self._publish()

    def teardown(self) -> None:
        """Free the world."""
        for subscription in getattr(self, "_subscriptions", ()):
            subscription.close()
        for device in getattr(self, "_arms", {}).values():
            device.close()
        if hasattr(self, "_reality"):
            self._reality.close()

    @property
    def stamp(self) -> float:
        """s, the time that the world has reached"""
        assert self._epoch is not None
        return self._epoch + self._steps * STEP

    def _advance(self, now: float) -> None:
        behind = max(0, math.floor((now - self.stamp) * RATE_HZ + _ROUNDING))
        if behind > MOST_STEPS:
            assert self._epoch is not None
            self._epoch += (behind - MOST_STEPS) * STEP
            self._waited += (behind - MOST_STEPS) * STEP
        if self._waited and now >= self._next_complaint:
            self.log.warning("this machine is too slow: the world waited %.2f s", self._waited)
            self._waited, self._next_complaint = 0.0, now + COMPLAINT_PERIOD
        for _ in range(min(behind, MOST_STEPS)):
            self._reality.step(self._elapsed())
            self._steps += 1

    def _elapsed(self) -> float | None:
        """Seconds since the start of the scenario; None before it."""
        return None if self._start is None or self.stamp < self._start else self.stamp - self._start

    def _take_start(self) -> None:
        """Start the timeline when told to, for the first time only."""
        payload, self._start_message = self._start_message, None
        if payload is None or self._start is not None:
            return
        try:
            self._start = decode_start(payload).stamp
        except WireError as error:
            self._drop(str(error))
        else:
            self._replay()

    def _replay(self) -> None:
        """After a start in the past, as of a plant that was restarted, do what was to happen until now."""
        passed = min(self._elapsed() or 0.0, self._duration)
        for step in range(math.floor(passed * RATE_HZ + _ROUNDING)):
            if self._reality.experimenter.is_done:
                return
            self._reality.step(step * STEP)

    def _take_commands(self) -> None:
        for name, device in self._arms.items():
            joints = len(self._reality.arms[name].names)
            while device.commands:
                try:
                    self._reality.obey(decode_command(device.commands.popleft(), joints), name)
                except WireError as error:
                    self._drop(str(error))

    def _obey_halt(self) -> None:
        """Stop arms by themselves when an emergency stop is ordered, whatever became of their controllers; say so."""
        told: dict[str, HaltReport] = {}
        for name, device in self._arms.items():
            self._reality.forbid(device.halt.reason, name)
            order = device.unanswered()
            if order is not None:
                others = told.get(order.id)
                moving = self._reality.is_moving(name) or (others is not None and others.moving)
                told[order.id] = HaltReport(self.name, order.id, order.halted, moving)
        for report in told.values():
            self.bus.publish(halt_report_key(self.keys, self.name), msgspec.msgpack.encode(report), Qos.STREAM)

    def _drop(self, reason: str) -> None:
        if self.dropped == 0:
            self.log.warning("message dropped (logged once): %s", reason)
        self.dropped += 1

    def _publish(self) -> None:
        reality, stamp, keys = self._reality, self.stamp, self.keys
        for name in self._arms if self._state_due(self._steps) else ():
            state = reality.arm_state(stamp, name)
            self.bus.publish(arm_state_key(keys, name), msgspec.msgpack.encode(state), Qos.STREAM)
        if self._truth_due(self._steps):
            self.bus.publish(keys.truth(), msgspec.msgpack.encode(reality.truth(stamp)), Qos.STREAM)
        is_due = self._camera_due(self._steps)
        for _ in range(len(self._exposed) if is_due else min(1, len(self._exposed))):
            self._publish_frame()
        if is_due:
            self._publish_sight(stamp)

    def _publish_sight(self, stamp: float) -> None:
        reality = self._reality
        if (persons := reality.person_readings(stamp)) is not None:
            self.bus.publish(persons_key(self.keys), msgspec.msgpack.encode(persons), Qos.STREAM)
        for camera in reality.delivering:
            self._publish_view(camera, stamp)

    def _publish_view(self, camera: SimulatedCamera, stamp: float) -> None:
        reality = self._reality
        if self.config.sensor == "pixels":
            self._exposed.append((camera, reality.expose(stamp, camera)))
        elif self.config.sensor == "none":
            camera.seen_poses(reality.world)  # frames count all the same: a false percept lasts some
        else:
            payload = msgspec.msgpack.encode(reality.readings(stamp, camera))
            self.bus.publish(readings_key(self.keys, camera.name), payload, Qos.STREAM)
            if (hands := reality.hand_readings(stamp, camera)) is not None:
                self.bus.publish(hands_key(self.keys, camera.name), msgspec.msgpack.encode(hands), Qos.STREAM)

    def _publish_frame(self) -> None:
        """Of the camera that waits longest for that: to draw and to deliver is too much for one tick."""
        camera, frame = self._exposed.popleft()
        self.bus.publish_bulk(frame_key(self.keys, camera.name), frame_chunks(frame()))

    def _keep_start(self, key: str, payload: bytes) -> None:
        self._start_message = payload


_HALF_TICK = RATE_HZ / Plant.rate_hz / 2
"""Steps of physics."""


class _ArmDevice:
    """What comes for one arm: commands of its controller, and emergency stops."""

    def __init__(self, bus: Transport, keys: Keys, name: str) -> None:
        self.commands: deque[bytes] = deque(maxlen=_COMMANDS_KEPT)
        self.halt = HaltLatch(bus, keys, arm=name)
        self._answered = 0
        key = arm_command_key(keys, name)
        self._subscription = bus.subscribe(key, lambda _, payload: self.commands.append(payload))

    def unanswered(self) -> HaltOrder | None:
        """The newest order, if it was heard again since the last call."""
        if self._answered == self.halt.heard:
            return None
        self._answered = self.halt.heard
        return self.halt.order

    def close(self) -> None:
        """Hear nothing more."""
        self._subscription.close()
        self.halt.close()


class _Every:
    """True once in each period of a rate, counted in steps of physics.

    A tick may come early or late. Up to half a tick of that changes nothing.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate = rate_hz
        self._last = -1

    def __call__(self, steps: int) -> bool:
        period = math.floor((steps + _HALF_TICK) * self._rate / RATE_HZ + 1e-9)
        passed, self._last = period > self._last, period
        return passed
