"""Hybrid logical clock: monotone, respects happened-before within its bound, close to physical time."""

from hypothesis import given
from hypothesis import strategies as st

from dsr.crdt.hlc import MAX_LEAD, MAX_STAMP, HybridClock, physical_time, stamp_at

times = st.lists(st.floats(0, 4e9), min_size=1, max_size=50)
stamps = st.integers(0, MAX_STAMP)


@given(times)
def test_stamps_strictly_increase_whatever_the_physical_clock_does(physical: list[float]) -> None:
    clock = HybridClock()
    issued = [clock.tick(now) for now in physical]
    assert issued == sorted(set(issued))


@given(st.floats(MAX_LEAD, 4e9), st.floats(-MAX_LEAD + 1.0, MAX_LEAD - 1.0))
def test_a_stamp_after_a_received_one_is_greater(sender_now: float, behind: float) -> None:
    sender, receiver = HybridClock(), HybridClock()
    sent = sender.tick(sender_now)
    receiver.observe(sent, sender_now - behind)
    assert receiver.tick(sender_now - behind) > sent


@given(st.lists(stamps), st.floats(0, 4e9))
def test_no_stamp_moves_a_clock_further_than_its_bound(received: list[int], now: float) -> None:
    clock = HybridClock()
    for stamp in received:
        clock.observe(stamp, now)
    assert clock.tick(now) <= stamp_at(now + MAX_LEAD) + 1


@given(st.floats(0, 1e15))
def test_a_clock_that_is_centuries_ahead_leaves_room_above_its_stamps(now: float) -> None:
    assert HybridClock().tick(now) < MAX_STAMP // 2 + 2


@given(times)
def test_stamps_stay_within_a_microsecond_of_the_greatest_physical_time(physical: list[float]) -> None:
    clock = HybridClock()
    for now in physical:
        stamp = clock.tick(now)
    assert abs(physical_time(stamp) - max(physical)) < 2e-6
