"""Acts that an assistant proposes: each with a preview, carried out only once a person has confirmed it."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable

import msgspec

from dsr.clock import Clock
from dsr.errors import ConfigError, DsrError, WireError
from dsr.vocabulary.proposed_acts import ActState, ProposedAct, decode_confirmation, encode_acts

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

    def propose(self, act: str, preview: list[str], carry_out: Callable[[], str]) -> ProposedAct:
        """Let an act wait for a person; `carry_out` does it and tells what came of it.

        Raises:
            ConfigError: if too many wait.
        """
        with self._lock:
            self._expire()
            if sum(one.state is ActState.WAITING for one in self._acts.values()) >= _MOST_OPEN:
                raise ConfigError(f"{_MOST_OPEN} acts wait for a person already; confirm or refuse them first")
            proposed = ProposedAct(uuid.uuid4().hex[:8], act, tuple(preview), self._clock.now() + VALID)
            self._acts[proposed.id] = proposed
            self._carry_out[proposed.id] = carry_out
            while len(self._acts) > _MOST_KEPT:
                del self._acts[next(iter(self._acts))]
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

    def decide(self, id: str, *, accept: bool) -> ProposedAct:
        """Carry an act out, or refuse it; one that does not wait any more stays as it is. Raises `ConfigError`."""
        with self._lock:
            self._expire()
            known = self._acts.get(id)
            if known is None:
                raise ConfigError(f"no act {id!r} was proposed here")
            if known.state is not ActState.WAITING:
                return known
            carry_out = self._carry_out.pop(id)
            self._acts[id] = msgspec.structs.replace(known, state=ActState.REFUSED)
            if not accept:
                return self._acts[id]
        try:
            decided = msgspec.structs.replace(known, state=ActState.DONE, outcome=carry_out())
        except DsrError as error:
            decided = msgspec.structs.replace(known, state=ActState.FAILED, outcome=str(error))
        with self._lock:
            self._acts[id] = decided
        return decided

    def answer(self, payload: bytes) -> bytes | None:
        """Answer a message of `encode_confirmation`: what waits, or the act that was decided on; None for nonsense."""
        try:
            decision = decode_confirmation(payload)
            acts = [self.decide(decision.id, accept=decision.accept)] if decision.id else self.waiting()
        except (WireError, ConfigError):
            return None
        return encode_acts(acts)

    def _expire(self) -> None:
        now = self._clock.now()
        for id, one in self._acts.items():
            if one.state is ActState.WAITING and now > one.until:
                self._acts[id] = msgspec.structs.replace(one, state=ActState.EXPIRED)
                self._carry_out.pop(id, None)
