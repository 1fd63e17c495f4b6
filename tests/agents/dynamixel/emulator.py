"""Dynamixel servos on a pseudo-terminal: protocol 2.0, with delays, lost and corrupt packets, and servos in trouble."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import tty

import numpy as np
from dynamixel_sdk import Protocol2PacketHandler

from agents.dynamixel.servos import Series
from dsr.clock import WALL_CLOCK, Clock

_HEADER = b"\xff\xff\xfd\x00"
_PING, _READ, _WRITE, _STATUS, _SYNC_READ, _SYNC_WRITE = 0x01, 0x02, 0x03, 0x55, 0x82, 0x83
_ALERT = 0x80
_TURN = 2 * np.pi


class Servo:
    """One servo: it goes to its goal at some rad/s while its torque is on."""

    def __init__(self, table: Series, pulses: int, position: float) -> None:
        self.table, self.pulses = table, pulses
        self.position, self.goal, self.velocity = position, position, 0.0
        self.memory = bytearray(1024)
        self.stalled = False
        self.current = 0.0
        self.silent = False
        self._heard = 0.0

    def heat(self) -> None:
        """It gets too hot, says so, and lets go."""
        self.memory[self.table.error] |= 0x04
        self.memory[self.table.torque] = 0

    def write(self, place: int, data: bytes) -> None:
        struck = self.memory[self.table.watchdog] == 0xFF
        if place == self.table.goal:
            if struck:
                return
            self.goal = (int.from_bytes(data, "little", signed=True) - self.table.zero) * _TURN / self.pulses
        self.memory[place : place + len(data)] = data

    def hear(self, now: float) -> None:
        self._heard = now

    def step(self, now: float, passed: float) -> None:
        limit = self.memory[self.table.watchdog]
        if 0 < limit < 0xFF and now - self._heard > 0.02 * limit:
            self.memory[self.table.watchdog] = 0xFF
            self.goal = self.position
        if not passed:
            return
        before = self.position
        if self.memory[self.table.torque] and not self.stalled:
            self.position += float(np.clip(self.goal - self.position, -5.0 * passed, 5.0 * passed))
        self.velocity = (self.position - before) / passed
        self.tell()

    def tell(self) -> None:
        """Write position, velocity and current to where they are read."""
        present = round(self.position * self.pulses / _TURN) + self.table.zero
        told = round(self.velocity / self.table.velocity_unit)
        drawn = round(self.current / self.table.current_unit)
        self.memory[self.table.present - 2 : self.table.present] = drawn.to_bytes(2, "little", signed=True)
        self.memory[self.table.present : self.table.present + 4] = told.to_bytes(4, "little", signed=True)
        self.memory[self.table.present + 4 : self.table.present + 8] = present.to_bytes(4, "little", signed=True)


class Emulator:
    """A line of servos. A context manager; `port` is for the driver.

    Args:
        servos: by id.
        seed: of what goes wrong on the line.
        clock: by which the servos move.
    """

    def __init__(self, servos: dict[int, Servo], seed: int = 0, clock: Clock = WALL_CLOCK) -> None:
        self.servos, self._clock = servos, clock
        for servo in servos.values():
            servo.tell()
        self.loss = self.corruption = self.delay = 0.0
        """Probabilities of each answer, and s"""
        self.writes = 0
        """Instructions that changed something."""
        self._rng = np.random.default_rng(seed)
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._ours)
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._over = threading.Event()
        self._rounds = 0
        """Times that the servos have moved"""
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Emulator:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(5.0)
        os.close(self._ours)
        os.close(self._theirs)

    def settle(self) -> None:
        """Wait until the servos have moved by the present time of the clock."""
        before = self._rounds
        while self._rounds < before + 2:
            WALL_CLOCK.wait(self._over, 0.002)

    def _run(self) -> None:
        waiting, last = b"", self._clock.monotonic()
        while not self._over.is_set():
            ready, _, _ = select.select([self._ours], [], [], 0.002)
            if ready:
                with contextlib.suppress(OSError):
                    waiting += os.read(self._ours, 4096)
            now = self._clock.monotonic()
            for servo in self.servos.values():
                servo.step(now, now - last)
            last = now
            self._rounds += 1
            waiting = self._take(waiting, now)

    def _take(self, data: bytes, now: float) -> bytes:
        """Carry out the whole packets in `data`; returns what is left."""
        while (start := data.find(_HEADER)) >= 0:
            data = data[start:]
            if len(data) < 7 or len(data) < (end := 7 + int.from_bytes(data[5:7], "little")):
                return data
            packet, data = data[:end], data[end:]
            if _crc(packet[:-2]) == int.from_bytes(packet[-2:], "little"):
                self._obey(packet[4], packet[7], packet[8:-2], now)
        return data[-3:]

    def _obey(self, id: int, instruction: int, parameters: bytes, now: float) -> None:
        for servo in self.servos.values():
            servo.hear(now)
        if instruction == _PING and id in self.servos:
            self._answer(id, b"\x00\x00\x01")
        elif instruction == _READ and id in self.servos:
            place, length = _two(parameters), _two(parameters[2:])
            self._answer(id, bytes(self.servos[id].memory[place : place + length]))
        elif instruction == _WRITE and id in self.servos:
            self.writes += 1
            self.servos[id].write(_two(parameters), parameters[2:])
            self._answer(id, b"")
        elif instruction == _SYNC_READ:
            place, length = _two(parameters), _two(parameters[2:])
            for each in parameters[4:]:
                if each in self.servos:
                    self._answer(each, bytes(self.servos[each].memory[place : place + length]))
        elif instruction == _SYNC_WRITE:
            self.writes += 1
            place, length = _two(parameters), _two(parameters[2:])
            for at in range(4, len(parameters), length + 1):
                if (meant := self.servos.get(parameters[at])) is not None:
                    meant.write(place, parameters[at + 1 : at + 1 + length])

    def _answer(self, id: int, data: bytes) -> None:
        servo = self.servos[id]
        if servo.silent or self._rng.random() < self.loss:
            return
        if self.delay:
            WALL_CLOCK.wait(threading.Event(), self.delay)
        alert = _ALERT if servo.memory[servo.table.error] else 0
        body = _HEADER + bytes([id]) + (len(data) + 4).to_bytes(2, "little") + bytes([_STATUS, alert]) + data
        packet = bytearray(body + _crc(body).to_bytes(2, "little"))
        if self._rng.random() < self.corruption:
            packet[-3] ^= 0x55
        with contextlib.suppress(OSError):
            os.write(self._ours, bytes(packet))


def _two(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")


def _crc(data: bytes) -> int:
    return int(Protocol2PacketHandler().updateCRC(0, list(data), len(data)))
