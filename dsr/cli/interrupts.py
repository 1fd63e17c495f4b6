"""How signals end a command: at once until it begins its work, and in good order from then on."""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import NoReturn

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of a command that Ctrl-C ended before there was an outcome, as in shells."""
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def end_at_once() -> None:
    """From now on a signal ends this process without a word, wherever it is: nothing has begun, or all is done.

    A `KeyboardInterrupt` would be shown as a traceback, or libraries that are being imported would turn it into errors
    of their own. Signals that are ignored, as by `nohup`, stay so.
    """
    for number in _ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def end_in_good_order() -> None:
    """From now on the signals that `end_at_once` follows raise `KeyboardInterrupt`."""
    for number in _ENDING:
        if signal.getsignal(number) is _end:
            signal.signal(number, signal.default_int_handler)


def _end(number: int, _frame: FrameType | None) -> NoReturn:
    os._exit(128 + number)
