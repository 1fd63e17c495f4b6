"""Makes proposals of missions and halts: their previews, and how each is carried out once it is confirmed."""

from __future__ import annotations

import uuid

from agents.assistant.acting import Acts
from dsr.errors import ConfigError
from dsr.memory import Memory
from dsr.narration.doings import goal_words
from dsr.vocabulary.contradictions import by_meaning
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.halting import HaltOrder, send_order, write_order
from dsr.vocabulary.intentions import add_intention, nobody_pursues
from dsr.vocabulary.proposed_acts import ProposedAct
from dsr.vocabulary.relations import SURFACES, THINGS, read_relations

_MOST_REASON = 200
"""Characters of the reason of a halt: one sentence"""
_MOST_GOAL = 500
"""Characters of a goal: more than a person reads before confirming"""
_WHO = "an assistant, confirmed by a person"


class Proposer:
    """Proposes acts on a memory.

    Args:
        memory: where a mission is written, and from where a halt is sent.
        acts: where proposals wait.
    """

    def __init__(self, memory: Memory, acts: Acts) -> None:
        self._memory, self._acts = memory, acts

    def propose(self, act: str, argument: str) -> ProposedAct:
        """Propose a `mission` with a goal, or a `halt` with a reason. Raises `ConfigError`."""
        if act == "mission":
            return self._mission(argument)
        if act == "halt":
            return self._halt(argument)
        raise ConfigError(f"no act {act!r}: expected mission or halt")

    def _mission(self, text: str) -> ProposedAct:
        if len(text) > _MOST_GOAL:
            raise ConfigError(f"a goal of {len(text)} characters: expected at most {_MOST_GOAL}")
        goal = self._checked(text)
        if conflict := by_meaning(goal):
            raise ConfigError(str(conflict))
        missing = goal.missing(read_relations(self._memory))
        preview = [f"The robot would bring about: {goal_words(str(goal))}."]
        preview.append(f"Not so yet: {', '.join(map(str, missing))}." if missing else "All of that holds already.")
        if nobody := nobody_pursues(self._memory):
            preview.append(f"Nothing would come of it: {nobody}.")
        return self._acts.propose(f"mission: {goal}", preview, lambda: self._begin(str(goal)))

    def _checked(self, text: str) -> Goal:
        """The goal of a text, whose things are all there. Raises `GoalError`."""
        goal = parse_goal(text)
        goal.check_names({node.name for node in self._memory.nodes((*THINGS, *SURFACES))})
        return goal

    def _begin(self, goal: str) -> str:
        self._checked(goal)  # something may have been taken away since it was proposed
        return f"intention {add_intention(self._memory, goal)} is written"

    def _halt(self, reason: str) -> ProposedAct:
        why = " ".join(reason[:_MOST_REASON].split())  # on one line, which nobody takes for a preview of ours
        preview = ["All arms would stop, and stay stopped until a person runs: dsr halt --release"]
        return self._acts.propose(f"halt: {why}", preview, lambda: self._stop(why))

    def _stop(self, why: str) -> str:
        memory = self._memory
        order = HaltOrder(uuid.uuid4().hex, True, _WHO, why, memory.clock.now())
        send_order(memory.transport, memory.keys, order)
        write_order(memory, order)
        return "the order to stop is sent and written"
