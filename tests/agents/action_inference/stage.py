"""Made-up observations at 20 Hz with percepts at 10 Hz, for one policy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from agents.action_inference.observation import Holder, ObservedGrasp, ObservedThing, Snapshot
from agents.action_inference.policy import InferencePolicy
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import Action

TICK = 0.05
PERCEPT = 0.1
MAX_AGE = 0.7
"""s without a percept after which a thing is not perceived"""


class Stage:
    """Things somewhere, and what a policy infers of them."""

    def __init__(self, policy: InferencePolicy, noise: float = 0.0, bias: float = 0.01) -> None:
        self.policy = policy
        self.now = 100.0
        self.things: dict[str, ObservedThing] = {}
        self.holders: dict[str, Holder] = {}
        self.visible: dict[str, bool] = {}
        self.true: dict[str, Vector3] = {}
        self.actions: list[tuple[float, Action]] = []
        """When noticed, and what."""
        self.confidences: list[float] = []
        """Of these."""
        self._noise = noise
        self._bias = bias
        self._rng = np.random.default_rng(3)
        self._ticks = 0

    def add(self, name: str, position: Vector3, size: Vector3 = (0.04, 0.04, 0.04), **values: object) -> None:
        """A thing that is seen, rests on the table, and is believed where it is."""
        self.true[name], self.visible[name] = position, True
        thing = ObservedThing(name, size, perceived=True, believed=Pose(position), on=frozenset({"table"}))
        self.things[name] = replace(thing, **values)  # type: ignore[arg-type]

    def change(self, name: str, **values: object) -> None:
        """From now on."""
        self.things[name] = replace(self.things[name], **values)  # type: ignore[arg-type]

    def grasp(self, name: str, *holders: str) -> None:
        """These hold it, and no others."""
        self.change(name, grasps=tuple(ObservedGrasp(holder, self.now) for holder in holders))

    def run(self, seconds: float, **speeds: Vector3) -> None:
        """Let time pass, while things (with their beliefs) move at these speeds (m/s)."""
        for _ in range(round(seconds / TICK)):
            self._ticks += 1
            self.now += TICK
            for name, speed in speeds.items():
                x, y, z = self.true[name]
                self.true[name] = (x + speed[0] * TICK, y + speed[1] * TICK, z + speed[2] * TICK)
                self.change(name, believed=Pose(self.true[name]))
            if self._ticks % round(PERCEPT / TICK) == 0:
                for name in self.things:
                    self._see(name)
            for name, thing in self.things.items():
                perceived = thing.seen is not None and self.now - thing.seen.stamp <= MAX_AGE
                self.change(name, perceived=perceived)
            inferences = self.policy.update(Snapshot(self.now, dict(self.things), dict(self.holders)))
            self.confidences += [inference.confidence for inference in inferences]
            self.actions += [(self.now, inference.action) for inference in inferences]

    @property
    def told(self) -> list[str]:
        """All actions so far."""
        return [str(action) for _, action in self.actions]

    def _see(self, name: str) -> None:
        if self.visible[name]:
            x, y, z = self.true[name]
            dx, dy, dz = self._noise * self._rng.normal(size=3)
            self.change(name, seen=Pose((x + dx, y + dy, z + dz + self._bias), stamp=self.now))
