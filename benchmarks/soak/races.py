"""Two processes write the same thing at the same moment, many times: then all replicas must be equal, and right."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.soak.fleet import Fleet, Plan
from benchmarks.soak.process import in_parallel
from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import GraphError, NodeTypeError
from dsr.math3d.transforms import Pose
from dsr.memory import Memory

SPACING = 0.02
"""s between two rounds."""
JITTER = 0.002
"""s by which one of the two may be later, in every other round."""
_LEAD, _SPIN = 0.3, 0.002
_TIMEOUT = 60.0
_PAUSE = threading.Event()

Elements = Mapping[str, Mapping[str, Any]]


class Race(NamedTuple):
    """What two processes do at once to the node `name`, and what must come out."""

    meaning: str
    prepare: Callable[[Memory, str], object]
    """Done by one of them long before."""
    act: Callable[[Memory, str, int], object]
    """Done by both; the last argument is 0 or 1."""
    holds: Callable[[Elements, str], bool]
    """Whether the outcome is one of those allowed."""


def _add(memory: Memory, name: str) -> None:
    memory.add_node(name, "cube")


def _add_connected(memory: Memory, name: str) -> None:
    memory.add_node("world", "world")
    memory.add_node(name, "cube")
    memory.add_edge("world", name, "RT", pose=Pose())


def _move(memory: Memory, name: str, role: int) -> None:
    memory.update_edge("world", name, "RT", pose=Pose((1.0 + role, 0.0, 0.0)))


def _describe(memory: Memory, name: str, role: int) -> None:
    memory.update_node(name, **({"mass": 1.5} if role else {"seen": 7}))


def _remove_or_write(memory: Memory, name: str, role: int) -> None:
    with contextlib.suppress(GraphError):  # the removal came first
        if role:
            memory.update_node(name, seen=7)
        else:
            memory.remove_node(name)


def _create(memory: Memory, name: str, role: int) -> None:
    values = {"mass": 1.5} if role else {"seen": 7}
    try:
        memory.add_node(name, "cup" if role else "ball", **values)
    except NodeTypeError:  # the other one was first
        memory.update_node(name, **values)


def _is_described(elements: Elements, name: str) -> bool:
    values = elements.get(name, {})
    return values.get("mass") == 1.5 and values.get("seen") == 7


RACES: dict[str, Race] = {
    "edge": Race(
        "both write the same RT edge: one of the two poses", _add_connected, _move,
        lambda elements, name: elements[f"world {name} RT"]["pose"][0] in (1.0, 2.0),
    ),
    "attributes": Race("each writes another attribute of one node: both are there", _add, _describe, _is_described),
    "delete": Race(
        "one removes, the other writes: it is gone", _add, _remove_or_write,
        lambda elements, name: name not in elements,
    ),
    "create": Race("both create the same name: one node with what both wrote", lambda *_: None, _create, _is_described),
}  # fmt: skip


def prepare(memory: Memory, race: str, names: Sequence[str]) -> None:
    """What one worker does before a race."""
    for name in names:
        RACES[race].prepare(memory, name)


def run(memory: Memory, race: str, names: Sequence[str], role: int, times: Sequence[float]) -> list[float]:
    """Act on each name at its time, s on the monotonic clock; returns when it really was."""
    return [_act_at(memory, RACES[race], name, role, time) for name, time in zip(names, times, strict=True)]


def _act_at(memory: Memory, race: Race, name: str, role: int, time: float) -> float:
    WALL_CLOCK.wait(_PAUSE, time - WALL_CLOCK.monotonic() - _SPIN)
    while (now := WALL_CLOCK.monotonic()) < time:
        pass
    race.act(memory, name, role)
    return now


def run_races(folder: Path, clock: Clock, rounds: int, seed: int, done: Callable[[str], None]) -> dict[str, Any]:
    """All races with two writers and a bystander, each in a process of its own; `done` is told after each race.

    Returns for each race the `rounds`, in how many all replicas were `equal` and the outcome `right`, and the median
    distance of the two writes in ms.
    """
    generator = np.random.default_rng(seed)
    result: dict[str, Any] = {}
    with Fleet(folder, clock, Plan(processes=3, machines=1, seed=seed)) as fleet:
        for race in RACES:
            result[race] = _run_race(fleet, race, [f"{race}{index}" for index in range(rounds)], generator)
            done(race)
    return result


def _run_race(fleet: Fleet, race: str, names: list[str], generator: np.random.Generator) -> dict[str, Any]:
    writers = fleet.everybody()[:2]
    writers[0].do("prepare_race", race=race, names=names)
    fleet.seconds_until_equal(fleet.clock.monotonic(), _TIMEOUT)
    ticks = fleet.clock.monotonic() + _LEAD + SPACING * np.arange(len(names))
    late = generator.uniform(0.0, JITTER, len(names)) * (np.arange(len(names)) % 2)
    first = generator.integers(2, size=len(names))
    for role, writer in enumerate(writers):
        times = (ticks + late * (first != role)).tolist()
        writer.send("run_race", race=race, names=names, role=role, times=times)
    moments = np.array([writer.receive() for writer in writers])
    fleet.seconds_until_equal(fleet.clock.monotonic(), _TIMEOUT)
    states: list[Elements] = in_parallel(fleet.everybody(), "state")
    equal = [len({str(_about(state, name)) for state in states}) == 1 for name in names]
    right = [all(RACES[race].holds(state, name) for state in states) for name in names]
    return {
        "meaning": RACES[race].meaning, "rounds": len(names), "equal": sum(equal), "right": sum(right),
        "apart_ms_median": float(np.median(np.abs(moments[0] - moments[1])) * 1e3),
    }  # fmt: skip


def _about(elements: Elements, name: str) -> list[Any]:
    """The node `name` and its RT edge, as one replica shows them."""
    return [elements.get(name), elements.get(f"world {name} RT")]
