"""Who claims to hold a part and never gives it is waited for only so long; who is slow or stopped is not overtaken."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.interest.claimant import KINDS, Claimant, Kind
from dsr import Faults, ManualClock, Memory, TransportError, WorldNotFoundError
from dsr.network.keys import Keys
from dsr.replication.debts import Debts
from dsr.replication.peers import FORGET, MAX_PEERS
from dsr.security.gate import Gate
from dsr.security.policy import AccessPolicy, Grant
from tests.dsr.conftest import Net
from tests.dsr.parts.test_parts import house

_ALL = Grant(("*",), ("*",), ("*",), trusted=True)
POLICY = AccessPolicy({"a": _ALL, "b": _ALL, "liar": Grant(("ball",))})
BOUND = FORGET + 10.0
"""s: what is counted, and what it takes until all are asked and the first piece has come"""


def lie(net: Net, kind: Kind, agent: str = "liar", number: int = 1, part: str = "kitchen") -> Claimant:
    """A claimant that speaks whenever the network is pumped."""
    transport = net.network.connect(agent)
    return Claimant(kind, transport, net.clock, "g", f"{agent}-{number}", (part,))


def pump(
    net: Net, seconds: float, *liars: Claimant, until: Callable[[], object] = lambda: False,
    faults: Faults | None = None,
) -> float:  # fmt: skip
    """Let time pass in which liars speak once a second; returns after how many s the condition held."""
    for second in range(round(seconds)):
        if until():
            return second
        for liar in liars:
            liar.speak()
        net.pump(1.0, faults)
    return seconds


def alone(net: Net, kind: Kind, **options: object) -> tuple[Memory, Claimant]:
    """A memory in whose graph a part is listed that nobody holds, and somebody who claims to."""
    a = net.join("a", interest=(), **options)
    a.replica.synchroniser.nobody_there()
    net.pump(1.0)
    a.create_part("kitchen")
    a.leave_part("kitchen")
    liar = lie(net, kind)
    pump(net, 2, liar)
    return a, liar


def joined(memory: Memory, part: str = "kitchen") -> bool:
    """Whether a part is complete, as far as one can know."""
    return memory.part_replica(part).synchroniser.joined


@pytest.mark.parametrize("secured", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_part_begins_though_somebody_claims_to_hold_it(
    net: Net, kind: Kind, secured: bool, caplog: pytest.LogCaptureFixture
) -> None:
    a, liar = alone(net, kind, gate=Gate(POLICY) if secured else None)
    a._parts("test").take("kitchen")
    with caplog.at_level(logging.WARNING, "dsr.replication.holders"):
        took = pump(net, 2 * BOUND, liar, until=lambda: joined(a))
    assert FORGET - 2 < took < BOUND + 5
    told = [record.args for record in caplog.records if record.name == "dsr.replication.holders"]
    assert told == [("part/kitchen", "liar-1", FORGET)]
    a.add_node("cup", "cube", "kitchen")
    assert "cup" in a


def test_who_comes_again_under_other_ids_has_no_more_time(net: Net) -> None:
    a, liar = alone(net, "is silent")
    a._parts("test").take("kitchen")
    number, took = 1, 0.0
    while not joined(a) and took < 4 * BOUND:
        took += pump(net, 6, liar, until=lambda: joined(a))
        liar._transport.close()
        number += 1
        liar = lie(net, "is silent", number=number)
    assert took < 2 * BOUND


def test_many_that_claim_are_waited_for_at_once(net: Net) -> None:
    a, liar = alone(net, "is silent")
    liars = [liar, *(lie(net, "is silent", f"liar{number}") for number in range(6))]
    pump(net, 2, *liars)
    a._parts("test").take("kitchen")
    assert pump(net, 4 * BOUND, *liars, until=lambda: joined(a)) < 2 * BOUND


def test_patience_that_ends_sooner_goes_on_when_it_is_asked_again(net: Net) -> None:
    a, liar = alone(net, "is not there")
    tries = 0
    while not joined_after_five_seconds(net, a, liar) and tries < 20:
        tries += 1
    assert FORGET / 5 - 1 <= tries <= FORGET / 5 + 3
    a.leave_part("kitchen")
    for _ in range(2):  # what is asked for much later is a new question
        pump(net, FORGET + 2, liar)
        assert not joined_after_five_seconds(net, a, liar)


def joined_after_five_seconds(net: Net, memory: Memory, liar: Claimant) -> bool:
    memory._parts("test").take("kitchen")
    pump(net, 5, liar)
    if not joined(memory):
        memory.leave_part("kitchen")
    return "kitchen" in memory.interest


def test_a_world_that_only_a_liar_claims_to_hold_is_held_by_nobody(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.0)
    a.create_world("plan")
    net.pump(1.0)
    channel = a.world_channels()["plan"]
    liar = lie(net, "is not there")
    liar._held[Keys("g", "plan", channel).place] = "liar-1w1"
    a.close()
    a.transport.close()
    net.memories.remove(a)
    pump(net, 5, liar)
    with pytest.raises(TransportError, match="liar-1w1: no answer"):
        b.world("plan")
    monkeypatch.setattr(b.transport, "pump", lambda: pump(net, 1, liar))
    for _ in range(round(FORGET) // 2):
        with pytest.raises((TransportError, WorldNotFoundError)):
            b.world("plan")
    with pytest.raises(WorldNotFoundError, match="nobody holds it any more"):
        b.world("plan")


def test_a_holder_that_is_stopped_is_not_overtaken_while_it_counts_as_there(net: Net) -> None:
    a, b = house(net)
    for _ in range(8):  # it speaks for a moment each time, while nobody asks it
        net.network.suspend("a")
        net.memories.remove(a)
        b._parts("test").take("kitchen")
        pump(net, FORGET - 5)
        assert not joined(b)
        b.leave_part("kitchen")
        net.network.resume("a")
        net.memories.append(a)
        pump(net, 1)
    b._parts("test").take("kitchen")
    pump(net, 3)
    assert joined(b) and "cup" in b and "cup" in a


def test_a_part_that_is_taken_again_and_again_waits_for_who_came_to_hold_it(net: Net) -> None:
    a, b = house(net)
    a.leave_part("kitchen")
    for _ in range(5):
        b._parts("test").take("kitchen")
        pump(net, 5)
        b.leave_part("kitchen")
        pump(net, 5)
    c = net.join("c", interest=())
    c._parts("test").take("kitchen")
    pump(net, 5)
    c.add_node("spoon", "cube", "kitchen")
    pump(net, 1)
    b._parts("test").take("kitchen")
    pump(net, 10, until=lambda: joined(b))
    assert joined(b) and "spoon" in b


@pytest.mark.parametrize(("count", "delay"), [(5, 1.2), (9, 1.2), (9, 2.5), (9, 4.5)])
@pytest.mark.parametrize("kind", ["never ends", "is silent", "waits itself", "begins anew", "makes up", "trickles"])
def test_a_slow_holder_is_not_given_up_while_liars_have_their_turns(
    net: Net, kind: Kind, count: int, delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 20)
    a, b = house(net)
    for k in range(100):
        a.add_node(f"thing_{k}", "cube", "kitchen")
    net.pump(2.0)
    liars = [lie(net, kind, f"liar{k}") for k in range(count)]
    pump(net, 3, *liars)
    b._parts("test").take("kitchen")
    took = pump(net, 300, *liars, until=lambda: joined(b), faults=Faults(delay=(delay, delay)))
    assert took < 300 and sum(node.name.startswith("thing") for node in b.nodes()) == 100


@pytest.mark.parametrize("kind", ["makes up", "never ends"])
def test_who_answers_an_earlier_question_while_it_is_asked_again_has_no_more_time(net: Net, kind: Kind) -> None:
    """A liar answers after 0.6 s, and is asked again after 0.5 s."""
    a, liar = alone(net, kind)
    a._parts("test").take("kitchen")
    assert pump(net, 2 * BOUND, liar, until=lambda: joined(a), faults=Faults(delay=(0.3, 0.3))) < BOUND + 5


@pytest.mark.parametrize(("count", "delay"), [(4, 1.2), (9, 1.2), (15, 0.5), (5, 2.0), (10, 2.0)])
def test_many_slow_holders_give_all_where_nobody_lies(
    net: Net, count: int, delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 100)
    a, b = house(net)
    for number in range(400):
        a.add_node(f"thing_{number}", "cube", "kitchen")
    net.pump(2.0)
    for number in range(count):
        net.join(f"holder{number}", interest=())._parts("test").take("kitchen")
    net.pump(15.0)
    b._parts("test").take("kitchen")
    took = pump(net, 300, until=lambda: joined(b), faults=Faults(delay=(delay, delay)))
    assert took < 300 and sum(node.name.startswith("thing") for node in b.nodes()) == 400


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("faults", [Faults(delay=(0.0, 3.0)), Faults(0.1, 0.1, (0.0, 0.4))], ids=["slow", "lossy"])
def test_a_slow_or_lossy_holder_is_not_overtaken(
    net: Net, faults: Faults, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 80)  # so the answer has six pieces, each asked for
    a, b = house(net)
    for number in range(400):
        a.add_node(f"thing_{number}", "cube", "kitchen")
    net.pump(2.0)
    net.network._random = np.random.default_rng(seed)
    b._parts("test").take("kitchen")
    took = pump(net, 1000, until=lambda: joined(b), faults=faults)
    assert 1 < took < 1000 and "thing_399" in b


def test_only_time_between_words_of_who_owes_something_counts() -> None:
    clock = ManualClock()
    debts, place = Debts(clock), "part/kitchen"

    def after(seconds: float, *, heard: bool = True, owing: bool = True, gave: bool = False) -> list[str]:
        clock.advance(seconds)
        word = clock.monotonic() if heard else clock.monotonic() - 1000.0
        return debts.count(place, ["a-1"], {"a-1": word} if owing else {}, {"a-1": 3.0} if gave else {})

    assert after(1.0) == [] and not debts._accounts  # nobody has asked
    debts.open(place)
    assert after(1.0) == []  # the first word is only the beginning
    for gave in (True, False):
        for _ in range(round(FORGET)):
            assert after(1.0) == after(5.0, heard=False) == []
            assert after(1.0, owing=False) == after(0.0) == []
        assert after(0.0, gave=gave) == []
    assert debts.waits_for(place, "a-1")
    assert after(1.0) == ["a-1"]
    assert after(1.0) == [] and not debts.waits_for(place, "a-1") and debts.waits_for("part/hall", "a-1")
    assert not debts.waits_for(place, "late-1")
    debts.close(place)
    assert debts.waits_for(place, "late-1") and debts.waits_for(place, "a-1")


@pytest.mark.parametrize(("share", "pause", "waited"), [(1.0, 9.0, 1000.0), (1e-3, 1.0, 40.0), (0.5, 6.0, 220.0)])
def test_pieces_that_bring_little_take_little_off(share: float, pause: float, waited: float) -> None:
    """A whole one takes off as much as one may take, 10 s; waited is for s at most, or for ever."""
    clock = ManualClock()
    debts, given_up = Debts(clock), 1000.0
    debts.open("part/kitchen")
    for second in range(1000):
        gave = {"a-1": share} if second % pause == pause - 1.0 else {}
        clock.advance(1.0)
        if debts.count("part/kitchen", ["a-1"], {"a-1": clock.monotonic()}, gave):
            given_up = min(given_up, second)
    assert given_up <= waited
    assert (given_up == 1000.0) is (share * 10.0 >= pause)


def test_what_is_counted_is_bounded() -> None:
    clock = ManualClock()
    debts = Debts(clock)
    for place in range(100):
        debts.open(f"part/{place}")
        debts.count(f"part/{place}", [f"made_up-{number}" for number in range(2 * MAX_PEERS)], {}, {})
    assert all(len(account.owed) == MAX_PEERS for account in debts._accounts.values())
    clock.advance(FORGET + 1.0)
    debts.open("part/other")
    assert list(debts._accounts) == ["part/other"]
