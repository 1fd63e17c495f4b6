"""Servos on one serial line: positions, velocities and faults in SI units, by protocol 2.0 of Dynamixel."""

from __future__ import annotations

import math
import termios
from collections.abc import Sequence
from typing import Any, NamedTuple

import dynamixel_sdk as sdk

from dsr.errors import ConfigError, DsrError, suggest


class ServoError(DsrError):
    """Servos do not answer, or not all of them."""


class Series(NamedTuple):
    """Places in the control table of a series of servos, and the unit of velocities."""

    torque: int
    error: int
    watchdog: int
    goal: int
    present: int
    """Velocity, and behind it the position, of 4 bytes each; before it the current, of 2 bytes"""
    velocity_unit: float
    """rad/s"""
    current_unit: float
    """A"""
    zero: int
    """Pulses at 0 rad: the middle of a turn"""


SERIES = {
    "P": Series(512, 518, 546, 564, 576, 0.01 * 2 * math.pi / 60, 0.001, 0),
    "X": Series(64, 70, 98, 116, 128, 0.229 * 2 * math.pi / 60, 0.00269, 2048),
}
"""By the first letter of the names: PH54, PM42; XM430, XL330. Of the e-Manual of ROBOTIS."""
FAULTS = {0x01: "input voltage", 0x04: "overheated", 0x08: "encoder", 0x10: "electrical shock", 0x20: "overloaded"}
"""Bits of the hardware error status"""
WATCHDOG_UNIT = 0.02
"""s, of the servos' own watchdog"""
_TURN = 2 * math.pi
_CURRENT = 2  # bytes


class Servos:
    """The servos of one arm, in the order of its joints.

    Args:
        port: of the serial line, such as `/dev/ttyUSB0`.
        baud: bit/s.
        ids: of the servos.
        series: `P` or `X`.
        pulses: of a turn, for each servo.

    Raises:
        ConfigError: for a series that is none, or a port that cannot be opened.
    """

    def __init__(self, port: str, baud: int, ids: Sequence[int], series: str, pulses: Sequence[int]) -> None:
        if series not in SERIES:
            raise ConfigError(f"series {series!r} of servos; {suggest(series, SERIES)}")
        self.table = SERIES[series]
        self._ids, self._pulses = tuple(ids), tuple(pulses)
        self._port = sdk.PortHandler(port)
        self._packets = sdk.PacketHandler(2.0)
        try:
            self._port.openPort()
            self._port.setBaudRate(baud)
        except (OSError, ValueError) as error:
            raise ConfigError(f"serial port {port!r} cannot be opened: {error}") from error
        self._state = sdk.GroupSyncRead(self._port, self._packets, self.table.present - _CURRENT, 8 + _CURRENT)
        self._error = sdk.GroupSyncRead(self._port, self._packets, self.table.error, 1)
        for id in self._ids:
            self._state.addParam(id)
            self._error.addParam(id)

    def read(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """Positions (rad), velocities (rad/s) and currents (A). Raises `ServoError` if a servo does not answer."""
        self._ask(self._state, "joints")
        velocities, positions, currents = [], [], []
        for id, pulses in zip(self._ids, self._pulses, strict=True):
            raw = (self._value(self._state, id, self.table.present + place, 4) for place in (0, 4))
            velocity, position = map(_signed, raw)
            current = self._value(self._state, id, self.table.present - _CURRENT, _CURRENT)
            currents.append(_signed(current, _CURRENT) * self.table.current_unit)
            velocities.append(velocity * self.table.velocity_unit)
            positions.append((position - self.table.zero) * _TURN / pulses)
        return tuple(positions), tuple(velocities), tuple(currents)

    def faults(self) -> dict[int, str]:
        """What servos say is wrong with them, by id. Raises `ServoError` if a servo does not answer."""
        self._ask(self._error, "faults")
        told = {id: self._value(self._error, id, self.table.error, 1) for id in self._ids}
        return {id: _words(bits) for id, bits in told.items() if bits}

    def command(self, positions: Sequence[float]) -> None:
        """Send positions (rad); nobody answers that."""
        writer = sdk.GroupSyncWrite(self._port, self._packets, self.table.goal, 4)
        for id, pulses, position in zip(self._ids, self._pulses, positions, strict=True):
            goal = round(position * pulses / _TURN) + self.table.zero
            writer.addParam(id, list((goal & 0xFFFFFFFF).to_bytes(4, "little")))
        writer.txPacket()

    def switch(self, *, torque: bool, watchdog: float) -> None:
        """Switch the torque, and have servos stop by themselves after `watchdog` s (0: never) without any message.

        Raises `ServoError` if a servo does not do it.
        """
        limit = math.ceil(watchdog / WATCHDOG_UNIT - 1e-9)
        for id in self._ids:
            self._write(id, self.table.watchdog, 0)  # as a watchdog that has struck is set free
            self._write(id, self.table.torque, int(torque))
            if limit:
                self._write(id, self.table.watchdog, limit)

    def close(self) -> None:
        """Close the serial line; harmless when repeated."""
        self._port.closePort()

    def _ask(self, reader: Any, what: str) -> None:
        try:
            result = reader.txRxPacket()
        except (OSError, termios.error) as error:  # unplugged
            raise ServoError(f"no {what} of the servos: {error}") from error
        if result != sdk.COMM_SUCCESS:
            raise ServoError(f"no {what} of the servos: {self._packets.getTxRxResult(result)}")

    def _value(self, reader: Any, id: int, place: int, length: int) -> int:
        if not reader.isAvailable(id, place, length):
            raise ServoError(f"servo {id} does not answer")
        if (told := len(reader.data_dict[id])) != reader.data_length:  # a late answer to another question
            raise ServoError(f"servo {id} answers with {told} bytes instead of {reader.data_length}")
        return int(reader.getData(id, place, length))

    def _write(self, id: int, place: int, value: int) -> None:
        result, _ = self._packets.write1ByteTxRx(self._port, id, place, value)
        if result != sdk.COMM_SUCCESS:
            raise ServoError(f"servo {id} does not answer: {self._packets.getTxRxResult(result)}")


def _signed(value: int, length: int = 4) -> int:
    """The number that an unsigned one of `length` bytes stands for."""
    bits = 8 * length
    return value - (1 << bits) if value >> (bits - 1) else value


def _words(bits: int) -> str:
    return ", ".join(text for bit, text in FAULTS.items() if bits & bit) or f"error {bits:#04x}"
