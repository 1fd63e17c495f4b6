"""Asks tool servers for the acts that assistants propose, and writes those that wait for a person as text."""

from __future__ import annotations

import math
import threading

from agents.viewer.texts import markdown
from dsr import Memory, WireError
from dsr.vocabulary.proposed_acts import ACTS_SERVICE, ActQuestion, ProposedAct, decode_acts, encode_question

_PERIOD = 1.0
"""s between two questions: a proposal waits for two minutes"""
_PATIENCE = 2.0
"""s for which answers are waited for"""
_LONGEST = 400
"""Characters of a sentence"""


class ProposalsWatch:
    """Knows what waits. Asks without blocking; answers come from other threads."""

    def __init__(self) -> None:
        self._due = -math.inf
        self._lock = threading.Lock()
        self._heard: list[ProposedAct] = []
        self._waiting: tuple[ProposedAct, ...] = ()
        self._is_asking = False

    def waiting(self, memory: Memory, now: float) -> list[ProposedAct]:
        """The acts that wait at time `now` (s), by the last answers; asks anew about once a second."""
        with self._lock:
            is_due = not self._is_asking and not self._due - _PERIOD <= now < self._due
            if is_due:
                self._due, self._is_asking, self._heard = now + _PERIOD, True, []
        if is_due:
            key = memory.keys.service(ACTS_SERVICE)
            memory.transport.request(key, encode_question(ActQuestion()), self._hear, self._end, _PATIENCE)
        with self._lock:
            return [act for act in self._waiting if act.until > now]

    def _hear(self, _key: str, payload: bytes) -> None:
        try:
            acts = decode_acts(payload)
        except WireError:
            return
        with self._lock:
            self._heard += acts

    def _end(self) -> None:
        with self._lock:
            self._waiting, self._is_asking = tuple(self._heard), False


def proposals_text(acts: list[ProposedAct], now: float) -> list[str]:
    """Markdown: what each act is, what would come of it, and how a person decides on it. Empty if none waits."""
    parts = ["**An assistant proposes, and a person decides in a terminal**"] if acts else []
    for act in acts:
        parts.append(f"**{markdown(act.act, _LONGEST)}**")
        parts += [markdown(sentence, _LONGEST) for sentence in act.preview]
        left = max(0.0, act.until - now)
        parts.append(f"`dsr assist confirm {act.id}`, or with `--refuse`; void in {left:.0f} s")
    return parts
