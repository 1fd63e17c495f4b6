"""Acts that an assistant proposes: each with a preview, carried out only once a person has confirmed it."""

from __future__ import annotations

import hmac
import logging
import threading
import uuid
from collections.abc import Callable

import msgspec

from dsr.clock import Clock
from dsr.errors import ConfigError, DsrError, WireError
from dsr.memory import Memory
from dsr.network.transport import Subscription
from dsr.vocabulary.proposed_acts import (
    ACTS_SERVICE,
    DECISIONS,
    ActState,
    ProposedAct,
    decode_confirmation,
    decode_question,
    encode_acts,
    fingerprint,
)

_log = logging.getLogger(__name__)
VALID = 120.0
"""s after which a proposal that nobody confirmed is void: the scene is another one by then"""
_MOST_OPEN = 5
"""Proposals that wait at once: more than a person can judge"""
_MOST_KEPT = 100
"""Proposals whose outcome can still be asked for"""


class Acts:
    """The proposals of one server. Safe from any thread.

    Args:
        clock: whose time counts.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._acts: dict[str, ProposedAct] = {}
        self._carry_out: dict[str, Callable[[], str]] = {}
        self._lock = threading.Lock()
        self._listening: tuple[Subscription, ...] = ()

    def propose(self, act: str, preview: list[str], carry_out: Callable[[], str]) -> ProposedAct:
        """Let an act wait for a person; `carry_out` does it and tells what came of it.

        Raises:
            ConfigError: if too many wait.
        """
        with self._lock:
            self._expire()
            if sum(one.state is ActState.WAITING for one in self._acts.values()) >= _MOST_OPEN:
                raise ConfigError(f"{_MOST_OPEN} acts wait for a person already; confirm or refuse them first")
            id = uuid.uuid4().hex[:8]
            while id in self._acts:  # another act of that id must not take the place of what somebody was shown
                id = uuid.uuid4().hex[:8]
            proposed = ProposedAct(id, act, tuple(preview), self._clock.now() + VALID)
            self._acts[id] = proposed
            self._carry_out[id] = carry_out
            while len(self._acts) > _MOST_KEPT:
                oldest = next(iter(self._acts))
                del self._acts[oldest]
                self._carry_out.pop(oldest, None)
            return proposed

    def get(self, id: str) -> ProposedAct:
        """The proposal with its state. Raises `ConfigError` for an unknown id."""
        with self._lock:
            self._expire()
            if id not in self._acts:
                raise ConfigError(f"no act {id!r} was proposed here")
            return self._acts[id]

    def waiting(self) -> list[ProposedAct]:
        """The proposals that wait, oldest first."""
        with self._lock:
            self._expire()
            return [one for one in self._acts.values() if one.state is ActState.WAITING]

    def decide(self, id: str, *, accept: bool, shown: str) -> ProposedAct:
        """Carry an act out, or refuse it; one that does not wait any more stays as it is.

        Args:
            id: of the act.
            accept: whether a person wants it.
            shown: `fingerprint` of what the person was shown.

        Raises:
            ConfigError: for an id that nobody proposed here, or an act that was shown otherwise.
        """
        with self._lock:
            self._expire()
            known = self._acts.get(id)
            if known is None:
                raise ConfigError(f"no act {id!r} was proposed here")
            if known.state is not ActState.WAITING:
                return known
            if accept and not hmac.compare_digest(shown.encode(), fingerprint(known).encode()):
                raise ConfigError(f"act {id!r} was shown otherwise than it is proposed here")
            carry_out = self._carry_out.pop(id)
            begun = msgspec.structs.replace(known, state=ActState.FAILED, outcome="it was begun and did not end")
            self._acts[id] = begun if accept else msgspec.structs.replace(known, state=ActState.REFUSED)
            if not accept:
                return self._acts[id]
        try:
            decided = msgspec.structs.replace(known, state=ActState.DONE, outcome=carry_out())
        except DsrError as error:
            decided = msgspec.structs.replace(known, state=ActState.FAILED, outcome=str(error))
        with self._lock:
            self._acts[id] = decided
        return decided

    def listen(self, memory: Memory) -> None:
        """Tell in a graph what waits, and heed what persons decide there."""
        keys, transport = memory.keys, memory.transport
        self._listening = (
            transport.serve(keys.service(ACTS_SERVICE), lambda _key, payload: self.answer(payload)),
            transport.subscribe(keys.service(DECISIONS), lambda _key, payload: self.heed(payload)),
        )

    def answer(self, payload: bytes) -> bytes | None:
        """Answer a message of `encode_question`: what waits, or one act; None for nonsense and an unknown act."""
        try:
            question = decode_question(payload)
            return encode_acts([self.get(question.id)] if question.id else self.waiting())
        except (WireError, ConfigError):
            return None

    def heed(self, payload: bytes) -> None:
        """Do what a message of `encode_confirmation` says; nonsense and what is about another act is dropped."""
        try:
            decision = decode_confirmation(payload)
            self.decide(decision.id, accept=decision.accept, shown=decision.shown)
        except (WireError, ConfigError) as error:
            _log.warning("a decision is dropped: %s", error)

    def _expire(self) -> None:
        now = self._clock.now()
        for id, one in self._acts.items():
            if one.state is ActState.WAITING and now > one.until:
                self._acts[id] = msgspec.structs.replace(one, state=ActState.EXPIRED)
                self._carry_out.pop(id, None)
