"""Proposals: they wait, expire, are refused or carried out once; and the limits of calls and answers."""

from __future__ import annotations

import pytest

from agents.assistant.acting import VALID, Acts
from agents.assistant.limits import RateLimit, trimmed
from dsr import ConfigError, ManualClock, TransportError
from dsr.vocabulary.proposed_acts import ActState, Confirmation, decode_acts, encode_confirmation


def failing() -> str:
    raise TransportError("the arm does not answer")


def test_an_act_is_carried_out_once() -> None:
    acts, done = Acts(ManualClock()), []
    act = acts.propose("mission: on(a,b)", ["It would be so."], lambda: done.append(1) or "begun")
    assert acts.waiting() == [act] and not done
    assert acts.decide(act.id, accept=True).outcome == "begun" and done == [1]
    assert acts.decide(act.id, accept=True).state is ActState.DONE and done == [1]
    assert acts.waiting() == []


def test_an_act_that_is_refused_or_fails_tells_so() -> None:
    acts = Acts(ManualClock())
    refused, failed = acts.propose("a", [], failing), acts.propose("b", [], failing)
    assert acts.decide(refused.id, accept=False).state is ActState.REFUSED
    assert acts.decide(refused.id, accept=True).state is ActState.REFUSED
    decided = acts.decide(failed.id, accept=True)
    assert (decided.state, decided.outcome) == (ActState.FAILED, "the arm does not answer")


def test_what_nobody_confirms_in_time_is_void() -> None:
    clock = ManualClock()
    acts = Acts(clock)
    act = acts.propose("a", [], failing)
    clock.advance(VALID + 1.0)
    assert acts.decide(act.id, accept=True).state is ActState.EXPIRED and acts.get(act.id).outcome == ""


def test_no_more_than_a_person_can_judge_wait() -> None:
    acts = Acts(ManualClock())
    first = acts.propose("a", [], failing)
    for _ in range(4):
        acts.propose("a", [], failing)
    with pytest.raises(ConfigError, match="5 acts wait for a person already"):
        acts.propose("a", [], failing)
    acts.decide(first.id, accept=False)
    acts.propose("a", [], failing)


def test_messages_ask_and_confirm_and_nonsense_gets_no_answer() -> None:
    acts = Acts(ManualClock())
    act = acts.propose("halt: now", ["All arms would stop."], lambda: "sent")
    listed = acts.answer(encode_confirmation(Confirmation()))
    assert listed is not None and decode_acts(listed) == [act]
    decided = acts.answer(encode_confirmation(Confirmation(act.id, True)))
    assert decided is not None and decode_acts(decided)[0].outcome == "sent"
    for payload in (b"", b"\xc1", b"\x91\x01", encode_confirmation(Confirmation("unknown", True))):
        assert acts.answer(payload) is None


def test_calls_may_come_in_bursts_and_then_at_a_rate() -> None:
    clock = ManualClock()
    limit = RateLimit(clock, per_second=2.0, burst=3)
    assert [limit.wait_time() for _ in range(4)] == [0.0, 0.0, 0.0, pytest.approx(0.5)]
    clock.advance(0.5)
    assert limit.wait_time() == 0.0 and limit.wait_time() > 0.0


def test_answers_keep_the_rows_that_fit() -> None:
    assert trimmed(["a"] * 3, 15) == (["a"] * 3, 0)
    assert trimmed(["a"] * 4, 15) == (["a"] * 3, 1)
    assert trimmed(["é"] * 2, 15) == (["é"], 1)  # six characters each, as ASCII
