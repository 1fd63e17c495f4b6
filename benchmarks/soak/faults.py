"""The faults: each goes on for a while and returns when it is healed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.soak.fleet import Fleet
from benchmarks.soak.journal import take_records
from benchmarks.soak.judge import Judge
from benchmarks.soak.process import Worker

_PAUSE = threading.Event()
_SLOW_RUN, _SLOW_STOP = 0.01, 0.09
"""s that a slow reader runs, and is stopped, in turn."""
_JOINING = 1.0
"""s within which a newcomer is starting and joining."""


@dataclass
class Scene:
    """What a fault acts on."""

    fleet: Fleet
    judge: Judge
    generator: np.random.Generator
    rate: float
    """Steps/s of each worker."""
    frozen: list[tuple[str, float, float]] = field(default_factory=list)
    """Slot, start and end of each time in which a worker was stopped on purpose."""

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.fleet.clock.wait(_PAUSE, seconds)

    def anybody(self) -> Worker:
        """A worker chosen at random."""
        workers = self.fleet.everybody()
        return workers[int(self.generator.integers(len(workers)))]

    def replace(self, victim: Worker) -> None:
        """Kill a worker while its successor is joining."""
        successor = self.fleet.launch(victim.slot)
        self.wait(float(self.generator.uniform(0.0, _JOINING)))
        killed_at = self.fleet.clock.monotonic()
        victim.kill()
        self.judge.note(victim.slot, take_records(victim.journal), killed_at)
        self.fleet.admit(successor)
        successor.do("run", rate=self.rate)


def kill(scene: Scene, seconds: float) -> None:
    """Any process is killed (SIGKILL) while another joins."""
    scene.replace(scene.anybody())


def kill_first(scene: Scene, seconds: float) -> None:
    """The oldest process, which newcomers ask for the content, is killed while another joins."""
    scene.replace(scene.fleet.everybody()[0])


def stop(scene: Scene, seconds: float) -> None:
    """A process is stopped (SIGSTOP) for a while."""
    worker = scene.anybody()
    begin = scene.fleet.clock.monotonic()
    worker.stop()
    scene.wait(seconds)
    worker.go_on()
    scene.frozen.append((worker.slot, begin, scene.fleet.clock.monotonic()))


def cut(scene: Scene, seconds: float) -> None:
    """The connections between the machines are closed, and refused for a while."""
    assert scene.fleet.wire is not None
    scene.fleet.wire.cut()
    scene.wait(seconds)
    scene.fleet.wire.heal()


def stall(scene: Scene, seconds: float) -> None:
    """The network between the machines passes nothing for a while, without a word."""
    assert scene.fleet.wire is not None
    scene.fleet.wire.stall()
    scene.wait(seconds)
    scene.fleet.wire.heal()


def hub(scene: Scene, seconds: float) -> None:
    """The hub is killed, and started again after a while."""
    assert scene.fleet.hub is not None
    scene.fleet.hub.kill()
    scene.wait(seconds)
    scene.fleet.hub.start()


def slow_reader(scene: Scene, seconds: float) -> None:
    """One process writes as fast as it can while another gets a tenth of the time (SIGSTOP and SIGCONT in turn)."""
    fast, slow = (scene.fleet.everybody()[int(i)] for i in scene.generator.permutation(len(scene.fleet.workers))[:2])
    begin = scene.fleet.clock.monotonic()
    fast.do("run", rate=0)
    while scene.fleet.clock.monotonic() < begin + seconds:
        slow.stop()
        scene.wait(_SLOW_STOP)
        slow.go_on()
        scene.wait(_SLOW_RUN)
    fast.do("run", rate=scene.rate)
    scene.frozen.append((slow.slot, begin, scene.fleet.clock.monotonic()))


Fault = Callable[[Scene, float], None]
FAULTS: dict[str, Fault] = {
    "kill": kill, "kill-first": kill_first, "stop": stop, "slow-reader": slow_reader, "cut": cut, "stall": stall,
    "hub": hub,
}  # fmt: skip
NEED_TWO_MACHINES = frozenset({"cut", "stall", "hub"})
