"""Puts explanations on record: in the graph, as nodes of the newest few, and in the log."""

from __future__ import annotations

import contextlib
import logging

from dsr.elements import Node
from dsr.errors import DsrError
from dsr.intentions import MIND
from dsr.memory import Memory
from simulation_handler.explaining import Explanation

_KEPT = 20  # events in the graph
_PREFIX = "event_"


class Events:
    """Writes explanations as nodes `event_N` beneath `mind`, the greatest N the newest; the oldest are removed.

    Args:
        memory: where to.
        policy: name of the method that explains.
        log: gets a line for each.
    """

    def __init__(self, memory: Memory, policy: str, log: logging.Logger) -> None:
        self._memory = memory
        self._policy = policy
        self._log = log

    def record(self, time: float, explanation: Explanation) -> None:
        """Write what was explained at `time` (s), and say of each object what explains it."""
        rejected = "\n".join(f"{score:.1f} {text}" for score, text in explanation.alternatives)
        score = "" if explanation.score is None else f" (score {explanation.score:.1f})"
        self._log.info("%s: explained as %s%s; rejected: %s", ", ".join(explanation.about), explanation.text, score,
                       rejected.replace("\n", "; ") or "nothing")  # fmt: skip
        self._add(time, explanation, rejected)
        for name in explanation.about:
            with contextlib.suppress(DsrError):
                self._memory.update_node(name, explanation=explanation.text)

    def _add(self, time: float, explanation: Explanation, rejected: str) -> None:
        known = sorted(filter(_is_numbered, self._memory.nodes("event")), key=_number)
        for old in known[: len(known) + 1 - _KEPT]:
            self._memory.remove_node(old.name)
        name = f"{_PREFIX}{_number(known[-1]) + 1 if known else 0}"
        values = {"time": time, "explanation": explanation.text, "policy": self._policy, "alternatives": rejected}
        score = {} if explanation.score is None else {"score": explanation.score}
        self._memory.add_node(name, "event", target=", ".join(explanation.about), **values, **score)
        if MIND in self._memory:
            self._memory.add_edge(MIND, name, "has")


def _is_numbered(node: Node) -> bool:
    return node.name.removeprefix(_PREFIX).isdecimal()


def _number(node: Node) -> int:
    return int(node.name.removeprefix(_PREFIX))
