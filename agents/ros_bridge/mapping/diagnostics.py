"""`diagnostic_msgs/DiagnosticArray` of the statuses of agents, for rqt_robot_monitor and Foxglove."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from agents.ros_bridge.mapping.stamps import to_header
from agents.ros_bridge.messages.types import RosTypes
from dsr.runtime.status import State, Status

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
_STATUS, _VALUE = "diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/KeyValue"
OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""Levels of DiagnosticStatus"""
_LEVELS = {State.READY: OK, State.STARTING: WARN, State.DEGRADED: WARN, State.STOPPED: WARN, State.FAILED: ERROR}


def to_diagnostics(types: RosTypes, stamp: float, graph: str, heard: Iterable[tuple[Status, bool]]) -> Any:
    """A message of statuses; each comes with whether its agent is silent, which makes it stale."""
    statuses = [_to_status(types, graph, status, silent) for status, silent in heard]
    return types.new(DIAGNOSTICS, header=to_header(types, stamp, ""), status=statuses)


def _to_status(types: RosTypes, graph: str, status: Status, silent: bool) -> Any:
    numbers = {
        "rate (Hz)": f"{status.rate_hz:.1f}",
        "tick, median (ms)": f"{status.tick_ms_p50:.2f}",
        "tick, 95 % (ms)": f"{status.tick_ms_p95:.2f}",
        "ticks missed": str(status.missed),
        "errors": str(status.errors),
        "restarts": str(status.restarts),
        "behind (s)": f"{status.behind:.1f}",
        "clock": status.clock,
        **{name: str(count) for name, count in status.counts.items()},
    }
    return types.new(
        _STATUS, level=STALE if silent else _LEVELS[status.state], name=f"{graph}: {status.agent}",
        message="silent" if silent else status.last_error or str(status.state), hardware_id=status.rid,
        values=[types.new(_VALUE, key=key, value=value) for key, value in numbers.items()],
    )  # fmt: skip
