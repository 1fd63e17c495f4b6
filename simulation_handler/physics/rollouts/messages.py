"""Messages between a pool and its workers: MessagePack, each message after its length."""

from __future__ import annotations

import socket
import struct

import msgspec

from simulation_handler.physics.rollouts.engine import RolloutOutcome
from simulation_handler.physics.rollouts.scene import RolloutBody

_LENGTH = struct.Struct("<I")


class RolloutJob(msgspec.Struct, frozen=True, array_like=True):
    """Bodies of a scene that is to be simulated for some s."""

    number: int
    bodies: tuple[RolloutBody, ...]
    seconds: float


class Reply(msgspec.Struct, frozen=True, array_like=True):
    """The outcome of the job of that number; neither outcome nor error for the first message: ready."""

    number: int
    outcome: RolloutOutcome | None = None
    error: str = ""


READY = Reply(0)
"""The first message of a worker; jobs have numbers from 1 on."""
_encoder = msgspec.msgpack.Encoder()
_jobs = msgspec.msgpack.Decoder(RolloutJob)
_replies = msgspec.msgpack.Decoder(Reply)


def send(connection: socket.socket, message: RolloutJob | Reply) -> None:
    """Send a message. Raises `OSError` if the other side is gone."""
    payload = _encoder.encode(message)
    connection.sendall(_LENGTH.pack(len(payload)) + payload)


def receive_job(connection: socket.socket) -> RolloutJob:
    """The next job. Raises `OSError` if the other side is gone."""
    return _jobs.decode(_received(connection))


def receive_reply(connection: socket.socket) -> Reply:
    """The next reply. Raises `OSError` if the other side is gone."""
    return _replies.decode(_received(connection))


def _received(connection: socket.socket) -> bytearray:
    (length,) = _LENGTH.unpack(_exactly(connection, _LENGTH.size))
    return _exactly(connection, length)


def _exactly(connection: socket.socket, length: int) -> bytearray:
    data = bytearray(length)
    rest = memoryview(data)
    while rest:
        count = connection.recv_into(rest)
        if not count:
            raise ConnectionResetError("the other side is gone")
        rest = rest[count:]
    return data
