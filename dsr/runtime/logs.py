"""Log records of agents: to the terminal or a file of their own, and over the bus for viewers and recordings."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import Path

import msgspec

from dsr.clock import Clock
from dsr.network.decoding import decoded
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Transport
from dsr.threads import acting_agent

_MOST_TEXT = 2000


class LogRecord(msgspec.Struct, frozen=True):
    """One line that an agent logged, as it travels (a MessagePack map)."""

    stamp: float
    """Time of the record, s since the Unix epoch."""
    level: str
    """DEBUG, INFO, WARNING, ERROR or CRITICAL"""
    agent: str
    text: str


def printable(text: str) -> str:
    """`text` from elsewhere without what a terminal would obey: control characters are shown as `\\x1b`."""
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


class PlainFormatter(logging.Formatter):
    """Formats records so that they show nothing but text."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as printable text."""
        return printable(super().format(record))


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(LogRecord)


def decode_log(payload: bytes) -> LogRecord:
    """The record of a message on `Keys.log`; raises `WireError`."""
    return decoded(payload, "log record", _decoder.decode)


class BusLogHandler(logging.Handler):
    """Sends records to `keys.log(agent)`, at most `most_per_second`; says how many it left out.

    Records of the transport itself stay in the terminal: sending them would cause more of them.
    """

    def __init__(self, bus: Transport, keys: Keys, agent: str, clock: Clock, most_per_second: int = 20) -> None:
        super().__init__(logging.INFO)
        self._bus = bus
        self._key = keys.log(agent)
        self._agent = agent
        self._clock = clock
        self._most = most_per_second
        self._second = -1
        self._sent = 0
        self._left_out = 0
        self._busy = threading.local()
        self.setFormatter(logging.Formatter("%(message)s"))

    def emit(self, record: logging.LogRecord) -> None:
        """Send `record`, unless there were too many within this second."""
        if getattr(self._busy, "sending", False) or "transport" in record.name or not self._may_send():
            return
        self._busy.sending = True
        try:
            text = self.format(record)
            if self._left_out:
                text += f" ({self._left_out} records before this one were left out)"
                self._left_out = 0
            line = LogRecord(self._clock.now(), record.levelname, self._agent, text[:_MOST_TEXT])
            self._bus.publish(self._key, _encoder.encode(line), Qos.STREAM)
        except Exception:
            self.handleError(record)
        finally:
            self._busy.sending = False

    def _may_send(self) -> bool:
        second = int(self._clock.monotonic())
        if second != self._second:
            self._second, self._sent = second, 0
        self._sent += 1
        if self._sent > self._most:
            self._left_out += 1
            return False
        return True


def said_by(*agents: str) -> Callable[[logging.LogRecord], bool]:
    """A filter that passes what threads log which work for these agents; "" stands for those that work for nobody."""
    return lambda record: acting_agent() in agents


def log_to_terminal(agent: str, level: str) -> logging.Handler:
    """Log all records of this process to stderr, each line with the agent's name; returns what does so."""
    handler = logging.StreamHandler()
    handler.setFormatter(_lines_of(agent))
    logging.basicConfig(level=level.upper(), handlers=[handler])
    return handler


def log_to_file(agent: str, file: Path) -> logging.Handler:
    """Log the records of `agent` alone, one of several in this process, to the end of a file; returns what does so."""
    handler = logging.FileHandler(file, encoding="utf-8")
    handler.setFormatter(_lines_of(agent))
    handler.addFilter(said_by(agent))
    logging.getLogger().addHandler(handler)
    return handler


def _lines_of(agent: str) -> PlainFormatter:
    return PlainFormatter(f"%(asctime)s %(levelname)-7s {agent}: %(message)s", datefmt="%H:%M:%S")
