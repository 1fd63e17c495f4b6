"""What is told of: the running system, a recording at a time, or a saved graph, as a moment of a memory."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from datetime import tzinfo
from pathlib import Path

from agents.replay.cli import open_recording
from agents.replay.control import replayed_time
from dsr.cli.common import reading
from dsr.cli.persist import warn
from dsr.clock import WALL_CLOCK, ManualClock
from dsr.errors import ConfigError
from dsr.memory import Memory
from dsr.narration import Moment
from dsr.network.keys import BASE
from dsr.network.local_transport import LocalNetwork
from dsr.persistence.files import read_graph

_TIMES = ("last_seen", "time", "begin", "end", "since")
"""Attributes of nodes and edges that are times (s)."""
_READER = "reader"


@contextlib.contextmanager
def moment_of(
    file: Path | None,
    at: float | None,
    graph: str | None,
    world: str,
    router: str | None,
    security: Path | None,
    zone: tzinfo | None = None,
) -> Iterator[Moment]:
    """The moment of which is told: read-only, and valid within the context.

    Args:
        file: a recording, the folder of a run, or a graph saved as JSON; None for the running system.
        at: s since the beginning of a recording; None for its end.
        graph: of the running system; see `dsr.cli.common.reading`, also for the others.
        world: likewise.
        router: likewise.
        security: likewise.
        zone: on whose calendar days are counted; None for that of this machine.

    Raises:
        ConfigError: for what does not go together, a time beyond the recording, and a file that cannot be read.
    """
    if file is None:
        if at is not None:
            raise ConfigError("--at is a time of a recording; a running system tells of now")
        with reading(graph, router, security, world) as memory:
            played = replayed_time(memory.transport, memory.keys)
            yield Moment(memory, WALL_CLOCK.now() if played is None else played, zone=zone)
        return
    if graph is not None or world != BASE:
        raise ConfigError("--graph and --world are for a running system; a file is one graph")
    moment = _saved(file, at) if file.suffix == ".json" else _recorded(file, at)
    yield moment._replace(zone=zone)


def _recorded(file: Path, at: float | None) -> Moment:
    source = open_recording(file)
    time = source.duration if at is None else at
    if not 0.0 <= time <= source.duration:
        raise ConfigError(f"--at {time:g}: expected 0 to {source.duration:.1f} s, where the recording ends")
    memory = source.at(time)
    return Moment(memory, memory.clock.now(), source.index.begin)


def _saved(file: Path, at: float | None) -> Moment:
    """A saved graph; its now is the newest time that it holds."""
    if at is not None:
        raise ConfigError("--at is a time of a recording; a saved graph is of one moment")
    content = read_graph(file)
    warn(content.warnings)
    values = [*(node.attributes for node in content.nodes.values()), *content.edges.values()]
    times = [value for attributes in values for name in _TIMES if isinstance(value := attributes.get(name), float)]
    now = max((time for time in times if math.isfinite(time)), default=0.0)
    clock = ManualClock(now)
    memory = Memory("saved", _READER, transport=LocalNetwork(clock).connect(_READER), clock=clock)
    warn(content.put_into(memory))
    return Moment(memory, now)
