"""One simulated machine: robots of a fleet, each with a Zenoh session of its own, that reach others through a router.

It is told on standard input what to do, a word a line, and answers with a line of JSON.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from pathlib import Path

import msgspec

import dsr
from benchmarks.interest.curves import CHANGES, POSES, ROOMS_OF_ROBOT, room
from dsr import Memory
from dsr.clock import WALL_CLOCK
from dsr.network.keys import WHOLE
from dsr.replication.replica import Replica

GRAPH = "fleet"
THINGS = 200
"""Nodes in each room that a robot made"""


class Job(msgspec.Struct):
    """What a machine is."""

    uplink: str
    """Endpoint through which it reaches all other machines."""
    runtime: str
    """Folder in which processes of this machine find each other."""
    robots: list[int]
    """Numbers of its robots in the fleet; none for a machine that only looks."""
    fleet: int
    """Robots in all."""
    parted: bool
    interest: list[int] = []
    """Rooms that a machine without robots asks for."""


class Told(msgspec.Struct):
    """What a machine has to tell."""

    writes: int = 0
    received: int = 0
    """Messages with changes that its robots got."""
    seconds: float = 0.0
    """Processor time."""
    holds: dict[str, list[int]] = {}
    """Hashes of what each replica has seen and holds, by part; of several robots on one machine they are alike."""
    differ: bool = False
    nodes: int = 0


class Robot:
    """A robot at work in a room of its own, which also holds those next to it."""

    def __init__(self, number: int, job: Job) -> None:
        self.here = room(number)
        self.body = f"body_{number}"
        interest = [room((number + each - 1) % job.fleet) for each in range(ROOMS_OF_ROBOT)]
        self.memory = joined(f"robot_{number}", job, interest)
        part = self.here if job.parted else WHOLE
        with self.memory.batch():
            self.memory.add_node(f"floor_{self.here}", "table", part)
            self.memory.add_node(self.body, "robot", part)
            self.memory.add_edge(f"floor_{self.here}", self.body, "RT", translation=(0, 0, 0))
            for thing in range(THINGS):
                self.memory.add_node(f"thing_{number}_{thing}", "cube", part, seen=thing)

    def write(self, step: int) -> int:
        """Write a sample of the pose, and now and then a change; returns how many writes that was."""
        self.memory.update_edge(f"floor_{self.here}", self.body, "RT", translation=(step, 0, 0))
        if step % POSES >= CHANGES:
            return 1
        self.memory.update_node(self.body, seen=step)
        return 2


def joined(agent: str, job: Job, rooms: list[str]) -> Memory:
    """A memory of the fleet's graph that holds these rooms, if there are parts."""
    memory = dsr.connect(
        GRAPH, agent, connect=[job.uplink], must_exist=False, begin=True, timeout=20.0,
        interest=() if job.parted else None,
    )  # fmt: skip
    if job.parted:
        memory.hold_part(*rooms, unlisted=True, timeout=20.0)
    return memory


class Machine:
    """Robots that write from a thread, so that questions are answered meanwhile."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self.robots = [Robot(number, job) for number in job.robots]
        looker = [] if job.robots else [joined("newcomer", job, [room(number) for number in job.interest])]
        self.memories = [*(robot.memory for robot in self.robots), *looker]
        self.writes = 0
        self._stop = threading.Event()
        self._work = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to write."""
        self._work.start()

    def stop(self) -> None:
        """Write nothing any more."""
        self._stop.set()
        self._work.join()

    def _run(self) -> None:
        due, step = WALL_CLOCK.monotonic(), 0
        while not WALL_CLOCK.wait(self._stop, max(0.0, due - WALL_CLOCK.monotonic())):
            self.writes += sum(robot.write(step) for robot in self.robots)
            due, step = due + 1.0 / POSES, step + 1

    def told(self) -> Told:
        """How it stands."""
        told = Told(self.writes, seconds=time.process_time(), nodes=sum(len(each.nodes()) for each in self.memories))
        for memory in self.memories:
            replicas: dict[str, Replica] = {WHOLE: memory.replica}
            replicas |= {part: memory.part_replica(part) for part in memory.interest}
            for part, replica in replicas.items():
                told.received += replica.received
                with replica.lock:
                    store = replica.graph.store
                    state = [store.context.hash, store.fingerprint]
                told.differ |= told.holds.setdefault(part, state) != state
        return told


def main() -> None:
    """Be a machine until standard input ends."""
    logging.disable(logging.WARNING)  # many begin at once, and say that they wait for each other
    job = msgspec.json.decode(Path(sys.argv[1]).read_bytes(), type=Job)
    machine = Machine(job)
    print(msgspec.json.encode(machine.told()).decode(), flush=True)
    for line in sys.stdin:
        if line.strip() in ("start", "stop"):
            getattr(machine, line.strip())()
        print(msgspec.json.encode(machine.told()).decode(), flush=True)
    for memory in machine.memories:
        memory.close()


if __name__ == "__main__":
    main()
