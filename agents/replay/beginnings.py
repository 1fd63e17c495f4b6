"""When the agents of a recording began to work, so that they can be run anew in step with it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from agents.recorder.opening import RecordingSource
from dsr.crdt.hlc import physical_time
from dsr.errors import WireError
from dsr.network.keys import agent_of
from dsr.replication.wire import decode_kept
from dsr.runtime.status import State, Status, decode_status

_ROUNDING = 1e-4  # s
_LOOKED_THROUGH = 60.0  # s of a recording in which an agent's first tick is looked for


def beginnings(index: RecordingSource, rates: Mapping[str, float]) -> dict[str, float]:
    """The stamps (s) of the first ticks of agents with these rates (Hz), by name.

    An agent that was at work when the recording began, or is never heard, begins with it. Its first write tells the
    moments at which it ticked, up to the time that a tick takes.
    """
    ready: dict[str, float] = {}
    starting: set[str] = set()
    wrote: dict[str, float] = {}
    for record in index.read_for(0.0):
        kind, _, name = record.topic.partition("/")
        try:
            if kind == "status" and name in rates and name not in ready:
                _note_status(decode_status(record.payload), index.begin + record.time, starting, ready)
            elif kind in ("d", "rt") and (agent := agent_of(name)) in rates and agent not in wrote:
                stamps = [write.stamp for write in decode_kept(record.payload).writes if write.writer == name]
                if stamps:
                    wrote[agent] = physical_time(min(stamps))
        except WireError:
            continue
        if record.time > _LOOKED_THROUGH or (len(ready) == len(rates) and len(wrote) == len(rates)):
            break
    return {
        name: _first_tick(index.begin, ready.get(name) if name in starting else None, wrote.get(name), 1.0 / rate)
        for name, rate in rates.items()
    }


def _note_status(status: Status, now: float, starting: set[str], ready: dict[str, float]) -> None:
    if status.state is State.STARTING:
        starting.add(status.agent)
    else:
        ready[status.agent] = now


def _first_tick(begin: float, ready: float | None, wrote: float | None, period: float) -> float:
    """The moment of a tick within the last period before it was `ready`, in step with when it first `wrote`."""
    earliest = begin if ready is None else max(begin, ready - period)
    if wrote is None:
        return earliest
    ticks = (wrote - earliest) / period
    late = (ticks - math.floor(ticks)) * period
    return earliest if min(late, period - late) < _ROUNDING else earliest + late
