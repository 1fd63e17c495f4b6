"""Proposals: they wait, expire, are refused or carried out once; and the limits of calls and answers."""

from __future__ import annotations

import uuid
from typing import Any

import msgspec
import pytest

from agents.assistant.acting import VALID, Acts
from agents.assistant.cli import _ask
from agents.assistant.limits import RateLimit, trimmed
from dsr import ConfigError, LocalNetwork, ManualClock, Memory, TransportError
from dsr.vocabulary.proposed_acts import (
    ActQuestion,
    ActState,
    Confirmation,
    ProposedAct,
    decode_acts,
    encode_acts,
    encode_confirmation,
    encode_question,
    fingerprint,
)


def failing() -> str:
    raise TransportError("the arm does not answer")


def decide(acts: Acts, act: ProposedAct, *, accept: bool) -> ProposedAct:
    """What a person decides who was shown the act as it is."""
    return acts.decide(act.id, accept=accept, shown=fingerprint(act))


def test_an_act_is_carried_out_once() -> None:
    acts, done = Acts(ManualClock()), []
    act = acts.propose("mission: on(a,b)", ["It would be so."], lambda: done.append(1) or "begun")
    assert acts.waiting() == [act] and not done
    assert decide(acts, act, accept=True).outcome == "begun" and done == [1]
    assert decide(acts, act, accept=True).state is ActState.DONE and done == [1]
    assert acts.waiting() == []


def test_an_act_that_is_refused_or_fails_tells_so() -> None:
    acts = Acts(ManualClock())
    refused, failed = acts.propose("a", [], failing), acts.propose("b", [], failing)
    assert decide(acts, refused, accept=False).state is ActState.REFUSED
    assert decide(acts, refused, accept=True).state is ActState.REFUSED
    decided = decide(acts, failed, accept=True)
    assert (decided.state, decided.outcome) == (ActState.FAILED, "the arm does not answer")


def test_what_nobody_confirms_in_time_is_void() -> None:
    clock = ManualClock()
    acts = Acts(clock)
    act = acts.propose("a", [], failing)
    clock.advance(VALID + 1.0)
    assert decide(acts, act, accept=True).state is ActState.EXPIRED and acts.get(act.id).outcome == ""


def test_no_more_than_a_person_can_judge_wait() -> None:
    acts = Acts(ManualClock())
    first = acts.propose("a", [], failing)
    for _ in range(4):
        acts.propose("a", [], failing)
    with pytest.raises(ConfigError, match="5 acts wait for a person already"):
        acts.propose("a", [], failing)
    decide(acts, first, accept=False)
    acts.propose("a", [], failing)


def test_messages_ask_and_confirm_and_nonsense_gets_no_answer() -> None:
    acts, done = Acts(ManualClock()), list[int]()
    act = acts.propose("halt: now", ["All arms would stop."], lambda: done.append(1) or "sent")
    listed = acts.answer(encode_question(ActQuestion()))
    assert listed is not None and decode_acts(listed) == [act]
    for payload in (b"", b"\xc1", b"\x91\x01", encode_confirmation(Confirmation("unknown", True, ""))):
        acts.heed(payload)
    assert acts.waiting() == [act]
    assert acts.answer(encode_question(ActQuestion("unknown"))) is None and acts.answer(b"\xc1") is None
    message = encode_confirmation(Confirmation(act.id, True, fingerprint(act)))
    acts.heed(message)
    acts.heed(message)  # the same again
    told = acts.answer(encode_question(ActQuestion(act.id)))
    assert told is not None and decode_acts(told)[0].outcome == "sent" and done == [1]


def test_one_answer_that_makes_no_sense_hides_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    act = Acts(ManualClock()).propose("halt: now", [], failing)
    other = msgspec.structs.replace(act, id="other", state=ActState.DONE)
    answers: list[bytes] = []
    transport = LocalNetwork(ManualClock()).connect("asker")

    def request(key: str, payload: bytes, on_reply: Any, on_done: Any, timeout: float) -> None:
        for answer in answers:
            on_reply(key, answer)
        on_done()

    monkeypatch.setattr(transport, "request", request)
    with Memory("g", "asker", transport=transport, clock=ManualClock()) as memory:
        answers += [b"\xc1", encode_acts([act]), b"\x91\x01"]
        assert _ask(memory, "") == _ask(memory, act.id) == [act]
        answers[1] = encode_acts([other])
        with pytest.raises(TransportError, match="no proposed act"):
            _ask(memory, act.id)


def test_only_what_was_shown_is_carried_out() -> None:
    acts = Acts(ManualClock())
    act = acts.propose("halt: now", ["All arms would stop."], failing)
    for other in (
        msgspec.structs.replace(act, act="mission: on(a,b)"),
        msgspec.structs.replace(act, preview=("Nothing would happen.",)),
        msgspec.structs.replace(act, preview=("All arms", " would stop.")),
    ):
        with pytest.raises(ConfigError, match="was shown otherwise"):
            acts.decide(act.id, accept=True, shown=fingerprint(other))
    with pytest.raises(ConfigError, match="was shown otherwise"):
        acts.decide(act.id, accept=True, shown="é")
    assert acts.waiting() == [act]
    assert acts.decide(act.id, accept=False, shown="").state is ActState.REFUSED  # to refuse needs no look


def test_an_act_that_breaks_on_the_way_is_not_told_as_refused() -> None:
    acts = Acts(ManualClock())

    def broken() -> str:
        raise ZeroDivisionError

    act = acts.propose("a", [], broken)
    with pytest.raises(ZeroDivisionError):
        decide(acts, act, accept=True)
    assert acts.get(act.id).state is ActState.FAILED and "did not end" in acts.get(act.id).outcome
    assert decide(acts, act, accept=True).state is ActState.FAILED


def test_a_new_act_never_takes_the_id_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = iter([uuid.UUID(int=1 << 100), uuid.UUID(int=1 << 100), uuid.UUID(int=2 << 100)])
    monkeypatch.setattr("agents.assistant.acting.uuid.uuid4", lambda: next(numbers))
    acts = Acts(ManualClock())
    first, second = acts.propose("a", [], failing), acts.propose("b", [], failing)
    assert first.id != second.id and acts.get(first.id).act == "a"


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
