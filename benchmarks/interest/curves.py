"""What interest costs and spares, on a network in memory: bytes and messages, which are the same in each run, and time.

Processor times are told beside one another only, of one run: a machine that does other things has others.
"""

from __future__ import annotations

import gc
import os
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.interest.counted import Fleet, Traffic
from dsr import Memory

IntArray = NDArray[np.int64]

NODES = 1000
"""Nodes of a room: things, furniture, places, with one attribute each"""
ROOMS_OF_ROBOT = 3
"""Rooms that a robot asks for: the one where it is, and its neighbours"""
POSES, CHANGES = 10, 1
"""Samples of a pose, and durable changes, that a robot writes per second"""


@dataclass
class Join:
    """What it cost a process to join."""

    rooms: int
    """Rooms of the building."""
    asked: int
    """Rooms that were asked for."""
    nodes: int
    """Nodes of the building."""
    received: int = 0
    """Bytes."""
    messages: int = 0
    seconds: float = 0.0
    """Processor time of all that took part."""
    memory: int = 0
    """Bytes that the newcomer holds afterwards."""


@dataclass
class Findings:
    """All curves."""

    by_building: list[Join] = field(default_factory=list)
    by_interest: list[Join] = field(default_factory=list)
    writers: list[dict[str, Any]] = field(default_factory=list)
    fleets: list[dict[str, Any]] = field(default_factory=list)
    idle: list[dict[str, Any]] = field(default_factory=list)


def room(number: int) -> str:
    """Name of a room."""
    return f"room_{number}"


def building(rooms: int, nodes: int = NODES) -> tuple[Fleet, Memory]:
    """A building that one process holds in whole."""
    fleet = Fleet()
    keeper = fleet.join("keeper")
    keeper.replica.synchroniser.nobody_there()
    for number in range(rooms):
        keeper.create_part(room(number))
        for thing in range(nodes):
            keeper.add_node(f"thing_{number}_{thing}", "cube", room(number), seen=thing)
    keeper.flush()
    return fleet, keeper


def whole(rooms: int) -> dict[str, Any]:
    """What it costs a process to hold a building in whole: memory of the process (bytes) and processor time (s)."""
    gc.disable()  # a million of nodes that stay are looked through again and again
    try:
        before, begin = _resident(), time.process_time()
        _, keeper = building(rooms)
        nodes = len(keeper.nodes())
        size, seconds = _resident() - before, time.process_time() - begin
    finally:
        gc.enable()
    return {"nodes": nodes, "bytes": size, "bytes_per_node": size / nodes, "seconds": seconds}


def _resident() -> int:
    """Bytes of memory that this process takes; Linux tells them."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def joined(rooms: int, asked: list[int]) -> list[Join]:
    """Join a building several times, each time with another number of rooms; each newcomer leaves again."""
    gc.disable()  # a million of nodes that stay are looked through again and again
    try:
        fleet, _ = building(rooms)
    finally:
        gc.enable()
    gc.freeze()
    found = [_joined(fleet, rooms, number) for number in asked]
    gc.unfreeze()
    return found


def _joined(fleet: Fleet, rooms: int, asked: int) -> Join:
    join = Join(rooms, asked, rooms * NODES)
    gc.collect()
    tracemalloc.start()
    begin = time.process_time()
    names = tuple(room(number) for number in range(asked))
    newcomer = fleet.join(f"newcomer_{asked}", names)
    while not newcomer.joined or len(newcomer.nodes()) < asked * NODES:
        fleet.live(0.05)
    join.seconds = time.process_time() - begin
    gc.collect()
    join.memory = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    traffic = fleet.traffic(newcomer).received
    join.received, join.messages = traffic.size, traffic.messages
    fleet.memories.remove(newcomer)
    newcomer.close()
    newcomer.transport.close()
    fleet.network.deliver()
    return join


def writer(readers: int, *, elsewhere: bool, writes: int = 100) -> dict[str, Any]:
    """What a writer in one room sends, while so many read in another one, or in the same."""
    fleet = Fleet()
    one = fleet.join("writer")
    one.replica.synchroniser.nobody_there()
    for number in (0, 1):
        one.create_part(room(number))
    one.add_node("cup", "cube", room(0))
    one.leave_part(room(1))
    for number in range(readers):
        fleet.join(f"reader_{number}", (room(1 if elsewhere else 0),))
    fleet.live(5.0)
    before = Traffic(**vars(fleet.traffic(one).sent))
    begin = time.process_time()
    for number in range(writes):
        one.update_node("cup", seen=number)
        one.flush()
    seconds = time.process_time() - begin
    fleet.network.deliver()
    sent = fleet.traffic(one).sent
    return {
        "readers": readers, "elsewhere": elsewhere, "messages": sent.messages - before.messages,
        "bytes": sent.size - before.size, "seconds": seconds,
    }  # fmt: skip


def fleet_of(robots: int, *, parted: bool, seconds: int = 3) -> dict[str, Any]:
    """Robots at work, each in a place of its own, two rooms for each: what one of them gets per second.

    Without parts each holds all. With them each holds three rooms, and moves on by one room halfway.
    """
    rooms = 2 * robots
    fleet = Fleet()
    first = fleet.join("first", () if parted else None)
    first.replica.synchroniser.nobody_there()
    for number in range(rooms) if parted else ():
        first.create_part(room(number))
        first.leave_part(room(number))
    for number in range(robots):
        interest = tuple(room((2 * number + each) % rooms) for each in range(ROOMS_OF_ROBOT))
        fleet.join(f"robot_{number}", interest if parted else None)
    fleet.live(3.0)
    at_work = fleet.memories[1:]
    for replica in [each for memory in at_work if memory._held for each in memory._held.replicas.values()]:
        replica.synchroniser.nobody_there()  # the rooms begin with them
    for number, memory in enumerate(at_work):
        here = room((2 * number + 1) % rooms) if parted else None
        memory.add_node("floor" if not parted else f"floor_{here}", "table", here)
        memory.add_node(f"body_{number}", "robot", here)
        memory.add_edge(f"floor_{here}" if parted else "floor", f"body_{number}", "RT", translation=(0, 0, 0))
    fleet.live(3.0)
    before = [_received(fleet, memory) for memory in at_work]
    begin = time.process_time()
    for second in range(seconds):
        for sample in range(POSES):
            for number, memory in enumerate(at_work):
                src = f"floor_{room((2 * number + 1) % rooms)}" if parted else "floor"
                memory.update_edge(src, f"body_{number}", "RT", translation=(second, sample, 0.0))
                if sample < CHANGES:
                    memory.update_node(f"body_{number}", seen=second)
            fleet.live(1.0 / POSES)
        if parted and second == seconds // 2:
            for number, memory in enumerate(at_work):
                memory.leave_part(room(2 * number % rooms))
                memory._parts("move").take(room((2 * number + ROOMS_OF_ROBOT) % rooms))
    spent = time.process_time() - begin
    share = 1.0 / (robots * seconds)
    told = [_received(fleet, memory) - earlier for memory, earlier in zip(at_work, before, strict=True)]
    (messages, size), digests, questions = (np.sum(told, axis=0) * share).tolist()
    return {
        "robots": robots, "parted": parted, "messages": messages, "bytes": size, "digests": digests,
        "questions": questions, "seconds": spent * share,
        "nodes": sum(len(memory.nodes()) for memory in at_work) / robots,
    }  # fmt: skip


def _received(fleet: Fleet, memory: Memory) -> IntArray:
    """Messages and bytes that a process got so far: in all, digests of the base, and who holds what; shape (3, 2)."""
    traffic = fleet.traffic(memory)
    return np.array([[each.messages, each.size] for each in (traffic.received, traffic.digests, traffic.questions)])


def idle(parts: int, seconds: int = 5) -> dict[str, Any]:
    """What a process sends per second, for each other one, that holds so many parts in which nothing happens."""
    fleet = Fleet()
    one = fleet.join("one")
    one.replica.synchroniser.nobody_there()
    for number in range(parts):
        one.create_part(room(number))
    fleet.join("other", tuple(room(number) for number in range(parts)))
    fleet.live(5.0)
    before = Traffic(**vars(fleet.traffic(one).sent))
    fleet.live(seconds)
    sent = fleet.traffic(one).sent
    return {
        "parts": parts, "messages": (sent.messages - before.messages) / seconds,
        "bytes": (sent.size - before.size) / seconds,
    }  # fmt: skip


def measured(tell: Callable[[str], None], *, rooms: tuple[int, ...] = (10, 100, 1000), robots: int = 50) -> Findings:
    """Measure all curves."""
    findings = Findings()
    for number in rooms:
        findings.by_building += joined(number, [ROOMS_OF_ROBOT])
        tell(f"{findings.by_building[-1]}")
    findings.by_interest = joined(min(100, max(rooms)), [each for each in (1, 3, 10, 30, 100) if each <= max(rooms)])
    for join in findings.by_interest:
        tell(f"{join}")
    for elsewhere in (True, False):
        for readers in (0, 4, 16, 64):
            findings.writers.append(writer(readers, elsewhere=elsewhere))
            tell(f"{findings.writers[-1]}")
    for number in (5, 10, 20, robots):
        for parted in (True, False):
            findings.fleets.append(fleet_of(number, parted=parted))
            tell(f"{findings.fleets[-1]}")
    for parts in (1, 3, 10, 30, 100):
        findings.idle.append(idle(parts))
        tell(f"{findings.idle[-1]}")
    return findings
