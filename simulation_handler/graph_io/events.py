"""Puts explanations on record: on the timeline, as events of the newest few, and in the log."""

from __future__ import annotations

import contextlib
import logging
from typing import Any

from dsr.errors import DsrError
from dsr.memory import Memory
from dsr.timeline import EXPLAINED, Chronicle, Retention
from dsr.vocabulary.explained import ATTRIBUTE, encoded
from dsr.vocabulary.sentences import rejected_sentences, sentence_of
from simulation_handler.explaining import Explanation
from simulation_handler.explaining.explainer import KEPT


class Events:
    """Writes explanations as events of kind `explained`, with the concerned objects as participants.

    Args:
        memory: where to.
        policy: name of the method that explains.
        log: gets a line for each.
    """

    def __init__(self, memory: Memory, policy: str, log: logging.Logger) -> None:
        self._memory = memory
        self._chronicle = Chronicle(memory, keep=Retention(count=KEPT))
        self._policy = policy
        self._log = log

    def record(self, time: float, explanation: Explanation) -> None:
        """Write the explanation of `time` (s), and its text at each object."""
        rejected = "\n".join(f"{score:.1f} {text}" for score, text in explanation.alternatives)
        score = "" if explanation.score is None else f" (score {explanation.score:.1f})"
        others = "; or ".join(
            f"{other.sentence} ({other.score})" for other in rejected_sentences({"alternatives": rejected})
        )
        self._log.info("%s: explained: %s%s. Rejected: %s", ", ".join(explanation.about),
                       sentence_of(explanation.changes), score, others or "nothing")  # fmt: skip
        self._write(time, explanation, rejected)
        for name in explanation.about:
            with contextlib.suppress(DsrError):
                self._memory.update_node(name, explanation=explanation.text)

    def _write(self, time: float, explanation: Explanation, rejected: str) -> None:
        details: dict[str, Any] = {
            "explanation": explanation.text,
            ATTRIBUTE: encoded(explanation.changes),
            "policy": self._policy,
            "alternatives": rejected,
            "target": ", ".join(explanation.about),
        }
        if explanation.score is not None:
            details["score"] = explanation.score
        self._chronicle.happened(EXPLAINED, explanation.about, time, text=explanation.text, **details)
