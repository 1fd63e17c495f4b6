"""The default policy: an action is what the belief says was done with a thing, and is as probable."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import MappingProxyType

from agents.action_inference.observation import ObservedThing, Snapshot
from agents.action_inference.policy import Inference
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, Action

_WHY = MappingProxyType({
    PICK: "it was taken up from where it lay",
    PLACE: "it rests, and nobody holds it any more",
    RELEASE: "nobody held it any more, and it came down",
})  # fmt: skip


class BelievedPolicy:
    """Tells each deed of the belief once."""

    name = "believed"

    def __init__(self) -> None:
        self._told: dict[str, float] = {}  # s, time of the last action with each thing

    def update(self, snapshot: Snapshot) -> list[Inference]:
        """Take in the snapshot, and return the actions that have become known, in the order of their times."""
        self._told = {name: time for name, time in self._told.items() if name in snapshot.things}
        new = (inference for thing in snapshot.things.values() for inference in self._new(thing))
        return sorted(new, key=lambda inference: (inference.action.time, inference.action.thing))

    def recall(self, action: Action) -> None:
        """What was done until then has been told."""
        self._told[action.thing] = action.time

    def _new(self, thing: ObservedThing) -> Iterator[Inference]:
        for deed in thing.deeds:
            if deed.time > self._told.get(thing.name, -math.inf):
                self._told[thing.name] = deed.time
                yield Inference(Action(deed.time, deed.kind, thing.name, deed.by), deed.probability, _WHY[deed.kind])
