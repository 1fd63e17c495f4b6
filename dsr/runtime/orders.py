"""What a launcher orders from a process that agents share, and what that reports: JSON objects, one a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from dsr.network.decoding import decoded

EXIT_FAILED = 1
EXIT_USAGE = 2
"""Exit code for wrong arguments or configuration: starting again would not help."""


class StartAgent(msgspec.Struct, frozen=True):
    """The order to start an agent; it is also started again by it."""

    name: str
    program: str
    """`module:Class`"""
    config: Mapping[str, Any]
    log_file: str
    restarts: int
    """Number of times that the agent was started before."""
    interest: tuple[str, ...] | None = None
    """Parts of the graph that it holds; None for those that its class declares."""


class AgentEnded(msgspec.Struct, frozen=True):
    """The report that an agent has ended by itself, and the process goes on."""

    name: str
    code: int
    """The exit code that it would have had as a process of its own."""


class Lines:
    """Puts lines together from the pieces in which they arrive."""

    def __init__(self) -> None:
        self._rest = b""

    def take(self, piece: bytes) -> list[bytes]:
        """The lines that `piece` completes."""
        *lines, self._rest = (self._rest + piece).split(b"\n")
        return lines


_order = msgspec.json.Decoder(StartAgent)
_report = msgspec.json.Decoder(AgentEnded)


def encode_line(message: StartAgent | AgentEnded) -> bytes:
    """The message as a line."""
    return msgspec.json.encode(message) + b"\n"


def decode_order(line: bytes) -> StartAgent:
    """The order in a line; raises `WireError`."""
    return decoded(line, "order", _order.decode)


def decode_report(line: bytes) -> AgentEnded:
    """The report in a line; raises `WireError`."""
    return decoded(line, "report", _report.decode)
