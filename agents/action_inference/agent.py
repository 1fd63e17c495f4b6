"""Writes the actions of hands and grippers on things, as events of the timeline."""

from __future__ import annotations

from agents.action_inference.believed import BelievedPolicy
from agents.action_inference.config import ActionInferenceConfig
from agents.action_inference.policy import Inference, InferencePolicy
from agents.action_inference.reading import SnapshotReader
from dsr.agent import Access, Agent
from dsr.config.plugins import ACTION_POLICIES, load
from dsr.perception.scales import TICK_RATE
from dsr.timeline import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES, Chronicle, Entry
from dsr.vocabulary.observed_actions import DEEDS, KINDS, Action
from dsr.vocabulary.relations import THINGS


class ActionInference(Agent):
    """Reads what the belief says was done with things; writes events `Pick`, `Place` and `Release`.

    Their participants are the thing and the hand or gripper that did it, or `unknown`; `confidence` is 0 to 1, `time`
    when it happened. After a restart it goes on from the events that it finds. What the timeline forgets for its age is
    not told again, though the belief still has it.
    """

    name = "action_inference"
    rate_hz = TICK_RATE
    shares_process = True
    reads = Access(
        nodes=(*THINGS, "world", *WRITTEN_NODES),
        edges=("Virtual_RT",),
        attributes=("perceived", "plausible", "present", DEEDS, *WRITTEN_ATTRIBUTES),
    )
    writes = Access(nodes=WRITTEN_NODES, edges=WRITTEN_EDGES, attributes=WRITTEN_ATTRIBUTES)
    Config = ActionInferenceConfig
    config: ActionInferenceConfig

    def setup(self) -> None:
        """Choose the policy."""
        self._policy: InferencePolicy = (
            BelievedPolicy()
            if self.config.policy == BelievedPolicy.name
            else load(ACTION_POLICIES, self.config.policy)(self.config.parameters)
        )
        self._reading = SnapshotReader(self.memory)
        self._chronicle = Chronicle(self.memory, self.name)
        self._has_recalled = False

    def tick(self, now: float) -> None:
        """Look, and write what has become known."""
        if not self._has_recalled:
            self._recall()
        for inference in self._policy.update(self._reading.snapshot(now)):
            self._write(inference)

    def _recall(self) -> None:
        """Take over what an earlier run has inferred."""
        self._has_recalled = True
        newest: dict[str, Action] = {}
        for entry in self._chronicle.query(kind=KINDS):
            action = _action(entry)
            if action is not None and action.time >= newest.get(action.thing, action).time:
                newest[action.thing] = action
        for action in newest.values():
            self._policy.recall(action)

    def _write(self, inference: Inference) -> None:
        action = inference.action
        text = f"{action}: {inference.why}"
        event = self._chronicle.happened(
            action.kind, (action.thing, action.by), action.time, text=text, confidence=inference.confidence,
            key=repr(action.time),
        )  # fmt: skip
        if event in self.memory:
            self.log.info("%s, at %.2f s (confidence %.2f)", text, action.time, inference.confidence)


def _action(entry: Entry) -> Action | None:
    if not entry.participants:
        return None
    thing, *others = entry.participants
    return Action(entry.begin, entry.kind, thing, *others[:1])
