"""The messages of what-if questions, and the side that asks."""

from __future__ import annotations

import math
import threading

import msgspec
import pytest

from dsr import LocalNetwork, ManualClock, Pose, TransportError, WireError
from dsr.network.keys import Keys
from dsr.network.transport import RequestHandler
from dsr.vocabulary.what_if import (
    MAX_CHANGES,
    Answer,
    Question,
    Supposed,
    WhatIf,
    WorldOutcome,
    decode_answer,
    decode_question,
    encode_answer,
    encode_question,
)

KEYS = Keys("g")
POSE = Pose.from_rotvec((0.3, 0.1, 0.06), (0.0, 0.0, 0.5))
ANSWER = Answer(
    stamp=7.0,
    seconds=0.5,
    at_rest=True,
    poses={"cube_3": (0.3, 0.1, 0.06, 0.0, 0.0, 0.0, 1.0)},
    moved={"cube_3": 0.001},
    turned={"cube_3": 0.01},
    rests_on={"cube_3": ("table",)},
    touches=(("cube_3", "table"),),
)


def test_questions_and_answers_come_back_as_they_were() -> None:
    question = Question(
        0.5, (Supposed.place("a", POSE), Supposed.hold("b"), Supposed.hold("c", POSE), Supposed.remove("d")), 9.0
    )
    assert decode_question(encode_question(question)) == question
    assert decode_answer(encode_answer(ANSWER)) == ANSWER
    assert question.changes[0].pose == (*POSE.t, *POSE.q)


def test_a_question_is_a_map_that_any_language_can_write() -> None:
    plain = {"seconds": 1, "changes": [{"object": "a", "action": "hold"}]}
    assert decode_question(msgspec.msgpack.encode(plain)) == Question(1.0, (Supposed.hold("a"),))


@pytest.mark.parametrize(
    "plain, message",
    [
        ({"seconds": 10.1}, "10"),
        ({"seconds": -0.1}, "0"),
        ({"seconds": math.nan}, "seconds"),
        ({}, "seconds"),
        ({"seconds": 1.0, "changes": [{"object": "a", "action": "throw"}]}, "'throw' - at `\\$.changes"),
        ({"seconds": 1.0, "changes": [{"object": "a", "action": "place", "pose": [1.0]}]}, "length 7"),
        ({"seconds": 1.0, "changes": [{"object": "a", "action": "hold"}] * (MAX_CHANGES + 1)}, "1000"),
        ("nonsense", "object"),
    ],
)
def test_a_malformed_question_is_an_error_that_says_why(plain: object, message: str) -> None:
    with pytest.raises(WireError, match=f"malformed what-if question.*{message}"):
        decode_question(msgspec.msgpack.encode(plain))


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x81\xa5poses\x01"])
def test_a_malformed_answer_is_an_error(payload: bytes) -> None:
    with pytest.raises(WireError, match="malformed what-if answer"):
        decode_answer(payload)


class Net:
    """Somebody who asks, and somebody who may answer."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.server = self.network.connect("server")
        self.what_if = WhatIf(self.network.connect("asker"), KEYS, self.clock, timeout=2.0)

    def serve(self, handler: RequestHandler) -> None:
        self.server.serve(KEYS.service("what_if"), handler)

    def pass_time(self, seconds: float = 0.0) -> None:
        self.clock.advance(seconds)
        self.network.deliver()


@pytest.fixture
def net() -> Net:
    return Net()


def test_an_answer_comes_with_what_is_delivered(net: Net) -> None:
    asked: list[Question] = []
    net.serve(lambda _, payload: asked.append(decode_question(payload)) or encode_answer(ANSWER))
    pending = net.what_if.ask(Question(0.5))
    assert not pending.done
    net.pass_time()
    assert pending.done and pending.answer == ANSWER and pending.failed == ""
    assert asked == [Question(0.5, expires=net.clock.now() + 2.0)]
    assert pending.answer.pose("cube_3").stamp == 7.5
    net.pass_time(3.0)
    assert pending.answer == ANSWER, "the time-out changes nothing any more"


def test_nobody_there_is_a_failure_at_once(net: Net) -> None:
    pending = net.what_if.ask(Question(0.5))
    net.pass_time(0.1)
    assert pending.done and pending.answer is None and "does the simulation handler run" in pending.failed


def test_no_answer_is_a_failure_after_the_time_out(net: Net) -> None:
    net.serve(lambda *_: None)
    pending = net.what_if.ask(Question(0.5))
    net.pass_time(1.9)
    assert not pending.done
    net.pass_time(0.2)
    assert pending.done and pending.answer is None and "does the simulation handler run" in pending.failed


def test_refusals_and_nonsense_are_failures(net: Net) -> None:
    replies = [encode_answer(Answer(refused="no object 'x'")), b"\xc1"]
    net.serve(lambda *_: replies.pop(0))
    refused, nonsense = net.what_if.ask(Question(0.5)), net.what_if.ask(Question(0.5))
    net.pass_time()
    assert (refused.answer, refused.failed) == (None, "no object 'x'")
    assert nonsense.answer is None and "malformed what-if answer" in nonsense.failed


def test_an_answer_fails_only_if_all_worlds_refuse(net: Net) -> None:
    refusing = Answer(refused="no room", weight=0.7, others=(WorldOutcome(weight=0.3, moved={"a": 0.1}),))
    hopeless = Answer(refused="no room", weight=0.7, others=(WorldOutcome(weight=0.3, refused="gone"),))
    replies = [encode_answer(refusing), encode_answer(hopeless), encode_answer(Answer(refused="late", weight=0.0))]
    net.serve(lambda *_: replies.pop(0))
    asked = [net.what_if.ask(Question(0.5, worlds=2)) for _ in range(3)]
    net.pass_time()
    assert asked[0].answer == refusing and asked[0].failed == "" and asked[0].refusals == ()
    assert asked[1].answer is None and asked[1].failed == "no room"
    assert [one.refused for one in asked[1].refusals] == ["no room", "gone"]
    assert asked[2].failed == "late" and asked[2].refusals == (), "it was tried in no world"
    assert refusing.probability(lambda one: not one.refused) == pytest.approx(0.3)


def test_the_effect_is_the_difference_from_what_happens_anyway() -> None:
    rolls = (0.5, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0)
    stopped = (0.4, 0.0, 0.03, *Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.5)).q)
    outcome = WorldOutcome(
        poses={"ball": stopped, "cube": POSE.t + POSE.q, "box": rolls},
        moved={"ball": 0.3, "cube": 0.02, "box": 0.4}, turned={"ball": 3.0, "cube": 0.1},
        anyway={"ball": rolls, "box": rolls},
    )  # fmt: skip
    assert outcome.effect("ball") == pytest.approx((0.1, 0.5)) and outcome.effect("cube") == (0.02, 0.1)
    assert outcome.effects == pytest.approx({"ball": 0.1, "cube": 0.02, "box": 0.0})
    assert decode_answer(encode_answer(Answer(anyway=outcome.anyway))).anyway == outcome.anyway


def test_the_first_of_two_answers_counts(net: Net) -> None:
    net.serve(lambda *_: encode_answer(ANSWER))
    net.serve(lambda *_: encode_answer(Answer(refused="late")))
    pending = net.what_if.ask(Question(0.5))
    net.pass_time()
    assert pending.answer == ANSWER


def test_waiting_for_what_does_not_come_is_an_error(net: Net) -> None:
    with pytest.raises(TransportError, match="what if\\? no answer in time"):
        net.what_if.ask_and_wait(Question(0.5))


def test_waiting_gives_the_answer(net: Net) -> None:
    net.serve(lambda *_: encode_answer(ANSWER))

    class Delivering(ManualClock):
        def wait(self, event: threading.Event, timeout: float) -> bool:
            net.network.deliver()
            return event.is_set()

    asker = WhatIf(net.network.connect("script"), KEYS, Delivering(), timeout=2.0)
    assert asker.ask_and_wait(Question(0.5)) == ANSWER
