"""The thread that all replicas of a memory share: regular, prompt, gone with the last of them."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from dsr.clock import WALL_CLOCK, WallClock
from dsr.replication.polling import Poller

PATIENCE = 20.0  # s


class Counted:
    """A poll that counts its calls."""

    def __init__(self) -> None:
        self.calls = threading.Semaphore(0)
        self.thread: threading.Thread | None = None

    def poll(self) -> None:
        self.thread = threading.current_thread()
        self.calls.release()

    def wait(self, calls: int = 1) -> bool:
        return all(self.calls.acquire(timeout=PATIENCE) for _ in range(calls))

    def drained(self) -> int:
        count = 0
        while self.calls.acquire(blocking=False):
            count += 1
        return count


class StillClock(WallClock):
    """On it no round is due but the first."""

    def monotonic(self) -> float:
        return 0.0


class BellClock(WallClock):
    """On it a thread waits until it is rung for."""

    def wait(self, event: threading.Event, timeout: float) -> bool:
        return event.wait(PATIENCE)


@pytest.fixture
def poller() -> Iterator[Poller]:
    before = set(threading.enumerate())
    yield Poller(WALL_CLOCK)
    assert not [thread for thread in set(threading.enumerate()) - before if thread.name == "dsr-sync"]


def test_all_are_polled_regularly_by_one_thread(poller: Poller) -> None:
    first, second = Counted(), Counted()
    poller.add(first.poll)
    poller.add(second.poll)
    assert first.wait(5) and second.wait(5)
    assert first.thread is second.thread is not None
    poller.remove(first.poll)
    first.drained()
    assert second.wait(3) and not first.drained()
    poller.remove(second.poll)


def test_who_asks_is_polled_between_the_rounds_and_nobody_else() -> None:
    poller, asking, other = Poller(StillClock()), Counted(), Counted()
    poller.add(other.poll)
    poller.add(asking.poll)
    assert asking.wait() and other.wait()
    asking.drained()
    other.drained()
    for _ in range(20):
        poller.ask(asking.poll)
        assert asking.wait()
    assert other.drained() <= 1
    poller.remove(other.poll)
    poller.remove(asking.poll)


def test_the_thread_ends_with_the_last_poll_without_waiting_for_the_next_round() -> None:
    poller, only = Poller(BellClock()), Counted()
    poller.add(only.poll)
    assert only.wait()
    poller.remove(only.poll)
    assert only.thread is not None and not only.thread.is_alive()


def test_a_poll_that_was_removed_has_returned_and_is_not_called_again(poller: Poller) -> None:
    entered, go_on, other = threading.Event(), threading.Event(), Counted()
    returned: list[bool] = []

    def slow() -> None:
        entered.set()
        assert go_on.wait(PATIENCE)
        returned.append(True)

    poller.add(other.poll)
    poller.add(slow)
    assert entered.wait(PATIENCE)
    threading.Timer(0.1, go_on.set).start()
    poller.remove(slow)
    assert returned == [True]
    poller.ask(slow)
    other.drained()
    assert other.wait(3) and returned == [True]
    poller.remove(other.poll)


def test_who_is_removed_does_not_wait_for_others(poller: Poller) -> None:
    entered, go_on, other = threading.Event(), threading.Event(), Counted()
    removed = threading.Event()

    def stuck() -> None:
        entered.set()
        assert go_on.wait(PATIENCE)

    def remove() -> None:
        poller.remove(other.poll)
        removed.set()

    poller.add(other.poll)
    poller.add(stuck)
    assert entered.wait(PATIENCE)
    threading.Thread(target=remove).start()
    was_removed = removed.wait(1.0)
    go_on.set()
    poller.remove(stuck)
    assert was_removed


def test_a_poll_may_remove_itself_and_others(poller: Poller) -> None:
    done, other = threading.Event(), Counted()

    def last() -> None:
        poller.remove(other.poll)
        poller.remove(last)
        done.set()

    poller.add(other.poll)
    assert other.wait()
    poller.add(last)
    assert done.wait(PATIENCE)
    thread = other.thread
    assert thread is not None
    thread.join(PATIENCE)
    other.drained()
    poller.add(other.poll)
    assert other.wait() and other.thread is not thread
    poller.remove(other.poll)
