"""Control of a running replay over the bus: messages, the service that takes them, a client."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Literal, get_args

import msgspec

from agents.replay.player import Player
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError, TransportError, WireError
from dsr.network.decoding import decoded
from dsr.network.keys import Keys
from dsr.network.transport import Transport

SERVICE = "replay"
Action = Literal["pause", "resume", "seek", "speed", "quit", "state"]
_NEEDS_VALUE = ("seek", "speed")
_MOST_WAITING = 100
_TIMEOUT = 2.0  # s for one answer
_RETRY = 0.02  # s between two looks whether a command was carried out


class Command(msgspec.Struct, frozen=True):
    """A request (a MessagePack map)."""

    do: Action
    value: float | None = None
    """s for `seek`; recorded seconds a second for `speed`, infinity for as fast as possible."""


class PlayState(msgspec.Struct, frozen=True):
    """The reply (a MessagePack map): the state when the request came."""

    time: float
    """s since the recording's first message"""
    until: float
    """Time (s) where the playing ends"""
    speed: float
    playing: bool
    ended: bool
    done: int
    """Commands carried out so far."""
    begin: float = 0.0
    """s, stamp of the recording's first message"""
    number: int = 0
    """Number of the command in this request; it is carried out once `done` has come to it."""
    error: str = ""
    """Why the request was refused."""


_commands = msgspec.msgpack.Decoder(Command)
_states = msgspec.msgpack.Decoder(PlayState)


def parse_command(text: str) -> Command:
    """The command in a text such as `pause` or `seek 12.5`. Raises `ConfigError`."""
    name, _, argument = text.strip().partition(" ")
    expected = "expected pause, resume, seek SECONDS, speed FACTOR (or max), state or quit"
    if name not in get_args(Action) or bool(argument.strip()) != (name in _NEEDS_VALUE):
        raise ConfigError(f"command {text!r}: {expected}")
    try:
        return _checked(msgspec.convert({"do": name, "value": _number(argument)}, Command))
    except ValueError as error:
        raise ConfigError(f"command {text!r}: {error}; {expected}") from error


def _number(text: str) -> float | None:
    text = text.strip()
    return math.inf if text == "max" else float(text) if text else None


def _checked(command: Command) -> Command:
    value = command.value
    if command.do == "seek" and (value is None or not math.isfinite(value)):
        raise ValueError(f"seek to {value} s")
    if command.do == "speed" and (value is None or not value > 0):
        raise ValueError(f"speed {value}: expected a positive number, or max")
    return command


class Controls:
    """Serves commands; `run` carries them out when the player may be touched."""

    def __init__(self, bus: Transport, keys: Keys, player: Player) -> None:
        self.wants_to_quit = False
        self._player = player
        self._waiting: deque[Command] = deque()
        self._taken = self._done = 0
        self._lock = threading.Lock()
        self._service = bus.serve(keys.service(SERVICE), self._answer)

    def run(self) -> None:
        """Carry out what was asked for."""
        while self._waiting:
            self.obey(self._waiting.popleft())
            self._done += 1

    def obey(self, command: Command) -> None:
        """Carry out one command."""
        player, value = self._player, command.value or 0.0
        match command.do:
            case "pause":
                player.pause()
            case "resume":
                player.resume()
            case "seek":
                player.seek(value)
            case "speed":
                player.set_speed(value)
            case "quit":
                self.wants_to_quit = True
            case "state":
                pass

    def close(self) -> None:
        """Take no more commands."""
        self._service.close()

    def _answer(self, _key: str, payload: bytes) -> bytes:
        with self._lock:
            number, error = self._take(payload)
        player = self._player
        state = PlayState(
            player.time,
            player.until,
            player.speed,
            player.playing,
            player.ended,
            self._done,
            player.begin,
            number,
            error,
        )
        return msgspec.msgpack.encode(state)

    def _take(self, payload: bytes) -> tuple[int, str]:
        try:
            command = decoded(payload, "command to a replay", _read_command)
        except WireError as error:
            return 0, str(error)
        if command.do == "state":
            return 0, ""
        if len(self._waiting) >= _MOST_WAITING:
            return 0, f"{_MOST_WAITING} commands are waiting"
        self._waiting.append(command)
        self._taken += 1
        return self._taken, ""


def _read_command(payload: bytes) -> Command:
    return _checked(_commands.decode(payload))


def send(bus: Transport, keys: Keys, command: Command, patience: float = 60.0) -> PlayState:
    """Let a running replay carry out a command; returns its state after that.

    Raises:
        ConfigError: if it refuses the command.
        TransportError: if no replay answers.
    """
    state = _ask(bus, keys, command)
    if state.error:
        raise ConfigError(state.error)
    number, end = state.number, WALL_CLOCK.monotonic() + patience
    while state.done < number or number == 0:
        if command.do == "quit" or number == 0:
            return state
        if WALL_CLOCK.monotonic() > end:
            raise TransportError(f"the replay has not carried out {command.do!r} after {patience:.0f} s")
        WALL_CLOCK.wait(threading.Event(), _RETRY)
        state = _ask(bus, keys, Command("state"))
    return state


def replayed_time(bus: Transport, keys: Keys) -> float | None:
    """Where the replay that plays this graph is, as a stamp of the recording (s); None if there is none."""
    try:
        state = _ask(bus, keys, Command("state"))
    except TransportError:
        return None
    return state.begin + state.time


def _ask(bus: Transport, keys: Keys, command: Command) -> PlayState:
    replies: list[bytes] = []
    done = threading.Event()

    def receive(_key: str, payload: bytes) -> None:
        replies.append(payload)
        done.set()

    bus.request(keys.service(SERVICE), msgspec.msgpack.encode(command), receive, done.set, _TIMEOUT)
    WALL_CLOCK.wait(done, _TIMEOUT)
    if not replies:
        raise TransportError(f"no replay answers in graph {keys.graph!r}")
    return decoded(replies[0], "state of a replay", _states.decode)
