"""Hybrid logical clock: monotone, respects happened-before, close to physical time."""

from hypothesis import given
from hypothesis import strategies as st

from dsr.crdt.hlc import HybridClock, physical_time

times = st.lists(st.floats(0, 4e9), min_size=1, max_size=50)


@given(times)
def test_stamps_strictly_increase_whatever_the_physical_clock_does(physical: list[float]) -> None:
    clock = HybridClock()
    stamps = [clock.tick(now) for now in physical]
    assert stamps == sorted(set(stamps))


@given(st.floats(0, 4e9), st.floats(0, 4e9))
def test_a_stamp_after_a_received_one_is_greater(sender_now: float, receiver_now: float) -> None:
    sender, receiver = HybridClock(), HybridClock()
    sent = sender.tick(sender_now)
    receiver.observe(sent)
    assert receiver.tick(receiver_now) > sent


@given(times)
def test_stamps_stay_within_a_microsecond_of_the_greatest_physical_time(physical: list[float]) -> None:
    clock = HybridClock()
    for now in physical:
        stamp = clock.tick(now)
    assert abs(physical_time(stamp) - max(physical)) < 2e-6
