"""Digests once a second, more while the network changes; patience that grows with what a peer leaves unanswered."""

from __future__ import annotations

from dsr.replication.pace import Pace
from dsr.replication.peers import FIRST_PATIENCE, LAST_PATIENCE, Peers


def digests(pace: Pace, begin: float, end: float) -> list[float]:
    """When digests are due, in steps of 50 ms."""
    times = [begin + 0.05 * step for step in range(round((end - begin) / 0.05))]
    due = []
    for time in times:
        pace.look(time)
        if pace.digest_due(time):
            due.append(round(time, 2))
    return due


def test_a_digest_a_second_and_several_when_a_peer_appears() -> None:
    pace = Pace()
    assert digests(pace, 0.0, 2.5) == [0.0, 1.0, 2.0]
    pace.hurry(2.5)
    assert digests(pace, 2.5, 6.0) == [2.5, 2.75, 3.0, 3.25, 3.5, 4.5, 5.5]


def test_a_process_that_was_stopped_hurries_when_it_goes_on() -> None:
    pace = Pace()
    digests(pace, 0.0, 1.5)
    assert digests(pace, 16.0, 18.0) == [16.0, 16.25, 16.5, 16.75, 17.0]


def test_stream_samples_are_made_durable_once_a_second_even_in_a_hurry() -> None:
    pace = Pace()
    pace.hurry(0.0)
    assert [time for time in range(30) if pace.settling_due(time / 10)] == [0, 10, 20]


def test_what_is_listened_to_is_declared_again_once_the_network_is_at_rest() -> None:
    pace = Pace()
    assert not pace.renewal_due(0.0)
    pace.hurry(1.0)
    pace.hurry(1.5)
    assert [time for time in (1.5, 2.0, 2.3, 2.4) if pace.renewal_due(time)] == [2.3]


def test_patience_doubles_with_each_request_in_vain_and_halves_with_each_answer() -> None:
    peers = Peers()
    for rid in ("slow-1", "other-1"):
        peers.appeared(rid, 0.0)
    waits = []
    for _ in range(6):
        waits.append(peers["slow-1"].patience)
        peers.came_late("slow-1")
    assert waits == [FIRST_PATIENCE, 1.0, 2.0, 4.0, LAST_PATIENCE, LAST_PATIENCE]
    for expected in (4.0, 2.0, 1.0, FIRST_PATIENCE, FIRST_PATIENCE):
        peers.answered("slow-1")
        assert peers["slow-1"].patience == expected
    assert peers["other-1"].patience == FIRST_PATIENCE
