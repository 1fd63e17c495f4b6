"""Made-up observations at 20 Hz, for one policy."""

from __future__ import annotations

from dataclasses import replace

from agents.action_inference.observation import ObservedThing, Snapshot
from agents.action_inference.policy import InferencePolicy
from dsr.vocabulary.observed_actions import Action, Deed

TICK = 0.05
"""s"""


class Stage:
    """Things of which the graph tells, and what a policy infers of them."""

    def __init__(self, policy: InferencePolicy) -> None:
        self.policy = policy
        self.now = 100.0
        self.things: dict[str, ObservedThing] = {}
        self.actions: list[tuple[float, Action]] = []
        """When noticed, and what."""
        self.confidences: list[float] = []
        """Of these."""

    def add(self, name: str) -> None:
        """A thing that is seen and believed where it is."""
        self.things[name] = ObservedThing(name, perceived=True, is_placed=True)

    def change(self, name: str, **values: bool) -> None:
        """Let other values of a thing hold from now on."""
        self.things[name] = replace(self.things[name], **values)

    def do(self, name: str, *deeds: Deed) -> None:
        """Let the belief say that this was done last with a thing."""
        self.things[name] = replace(self.things[name], deeds=deeds)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            inferences = self.policy.update(Snapshot(self.now, dict(self.things)))
            self.confidences += [inference.confidence for inference in inferences]
            self.actions += [(self.now, inference.action) for inference in inferences]

    @property
    def told(self) -> list[str]:
        """All actions so far."""
        return [str(action) for _, action in self.actions]
