"""The interface of the methods that infer actions."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from agents.action_inference.observation import Snapshot
from dsr.vocabulary.observed_actions import Action


class Inference(NamedTuple):
    """An action that was inferred."""

    action: Action
    """The action, with the time when it happened, not when that was noticed."""
    confidence: float
    """Probability (0 to 1) that the action is true."""
    why: str
    """The evidence, in a few words."""


class InferencePolicy(Protocol):
    """A method that infers actions."""

    name: str

    def update(self, snapshot: Snapshot) -> list[Inference]:
        """Take in the snapshot, and return the actions that have become known at this moment."""

    def recall(self, action: Action) -> None:
        """An earlier run has inferred this action, the last one of its thing."""
