"""Signals end a process in good order, whatever its main thread is doing."""

from __future__ import annotations

import signal
import threading

import pytest

from dsr.runtime.signals import ENDING, set_on_signals


class Watched(threading.Event):
    """Keeps which thread set it."""

    by: threading.Thread | None = None

    def set(self) -> None:
        self.by = threading.current_thread()
        super().set()


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_sets_the_event_from_another_thread(number: signal.Signals) -> None:
    stop = Watched()
    with set_on_signals(stop):
        signal.raise_signal(number)
        assert stop.wait(10)
    assert stop.by is not threading.main_thread()  # it may hold the event's lock


def test_other_signals_do_not() -> None:
    stop = Watched()
    earlier = signal.signal(signal.SIGUSR1, lambda *_: None)
    try:
        with set_on_signals(stop):
            signal.raise_signal(signal.SIGUSR1)
    finally:
        signal.signal(signal.SIGUSR1, earlier)
    assert not stop.is_set()


def test_afterwards_signals_do_what_they_did_before() -> None:
    before = [signal.getsignal(number) for number in ENDING]
    with set_on_signals(threading.Event()):
        assert [signal.getsignal(number) for number in ENDING] != before
    assert [signal.getsignal(number) for number in ENDING] == before
