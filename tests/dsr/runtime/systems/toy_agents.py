"""Agents for the launcher's tests, started as `python -m toy_agents_<kind>` or loaded from here."""

from __future__ import annotations

import signal
import subprocess

import msgspec

from dsr.agent import Agent
from dsr.graph.access import Access


class CounterConfig(msgspec.Struct, frozen=True):
    node: str = "cube_1"
    step: float = 1.0


class Counter(Agent):
    """Counts its ticks in a node's mass."""

    name = "counter"
    rate_hz = 20.0
    writes = Access(nodes=("cube",), attributes=("mass",))
    Config = CounterConfig

    def setup(self) -> None:
        if self.config.node not in self.memory:
            self.memory.add_node(self.config.node, "cube", mass=0.0)

    def tick(self, now: float) -> None:
        self.memory.update_node(self.config.node, mass=self.memory.node(self.config.node)["mass"] + self.config.step)


class Sleepy(Agent):
    """Ticks once in ten minutes."""

    name = "sleepy"
    rate_hz = 1 / 600

    def tick(self, now: float) -> None:
        pass


class Owner(Agent):
    """Claims the mass for itself."""

    name = "owner"
    writes = Access(attributes=("mass",), exclusive=("mass",))

    def tick(self, now: float) -> None:
        pass


class Broken(Agent):
    """Cannot be set up."""

    name = "broken"

    def setup(self) -> None:
        raise RuntimeError("the motor does not answer")


class Deaf(Agent):
    """Ignores every request to end, and has a child."""

    name = "deaf"

    def setup(self) -> None:
        self.child = subprocess.Popen(["sleep", "1000"])
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def teardown(self) -> None:
        while True:
            signal.pause()
