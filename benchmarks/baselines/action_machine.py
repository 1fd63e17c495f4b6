"""The published state machine: plausibility and perception alone tell what was done (Sallami et al., Fig. 4)."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
from msgspec import Meta

from agents.action_inference.observation import ObservedThing, Snapshot
from agents.action_inference.policy import Inference
from dsr.config.toml import convert
from dsr.vocabulary.observed_actions import KINDS, PICK, PLACE, RELEASE, Action

_Positive = Annotated[float, Meta(gt=0.0)]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class PublishedMachine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the published state machine."""

    threshold: _Share = 0.85
    """Confidence beyond which an action is inferred."""
    gain: _Positive = 1.85
    """By which a confidence is multiplied at each update at which the condition of its action holds."""
    loss: _Share = 0.15
    """Likewise, when it does not hold."""
    floor: _Share = 0.1
    """Least confidence."""


class State(enum.Enum):
    """Of a thing."""

    PLACED = "placed"
    HELD = "held"
    RELEASED = "released"


_AFTER = {PICK: State.HELD, PLACE: State.PLACED, RELEASE: State.RELEASED}


@dataclass
class Machine:
    """State of one thing, and how sure each action is."""

    parameters: PublishedMachine
    state: State = State.PLACED
    confidences: dict[str, float] = field(default_factory=dict)

    def update(self, perceived: bool, plausible: bool) -> tuple[str, float] | None:
        """The action that has become sure enough, with its confidence (at most 1)."""
        held = self.state is State.HELD
        conditions = {
            PICK: not held and perceived and not plausible,
            PLACE: held and perceived and plausible,
            RELEASE: held and not perceived,
        }
        parameters = self.parameters
        for kind in KINDS:
            factor = parameters.gain if conditions[kind] else parameters.loss
            confidence = self.confidences.get(kind, parameters.floor) * factor
            self.confidences[kind] = min(1.0, max(parameters.floor, confidence))
        sure = next(
            (kind for kind in KINDS if conditions[kind] and self.confidences[kind] > parameters.threshold), None
        )
        if sure is None:
            return None
        confidence, self.confidences, self.state = self.confidences[sure], {}, _AFTER[sure]
        return sure, confidence


class PublishedPolicy:
    """Of each thing: implausible and perceived is `Pick`, then plausible and perceived `Place`, unperceived `Release`.

    Times are those at which it becomes sure enough; nobody is told to have done it.
    """

    name = "published"

    def __init__(self, parameters: Mapping[str, float] | None = None) -> None:
        """Raise `ConfigError` for parameters that `PublishedMachine` does not have, or that make no sense."""
        self._parameters = convert(dict(parameters or {}), PublishedMachine, "parameters")
        self._machines: dict[str, Machine] = {}

    def update(self, snapshot: Snapshot) -> list[Inference]:
        """What has become sure."""
        self._machines = {name: machine for name, machine in self._machines.items() if name in snapshot.things}
        found = (self._infer(thing, snapshot.now) for _, thing in sorted(snapshot.things.items()))
        return [inference for inference in found if inference is not None]

    def recall(self, action: Action) -> None:
        """Go on in the state after this action."""
        self._machine(action.thing).state = _AFTER[action.kind]

    def _infer(self, thing: ObservedThing, now: float) -> Inference | None:
        if not thing.is_placed:
            return None
        sure = self._machine(thing.name).update(thing.perceived, thing.plausible)
        if sure is None:
            return None
        why = f"{'perceived' if thing.perceived else 'not perceived'}, {'' if thing.plausible else 'not '}plausible"
        return Inference(Action(now, sure[0], thing.name), sure[1], why)

    def _machine(self, name: str) -> Machine:
        return self._machines.setdefault(name, Machine(self._parameters))
