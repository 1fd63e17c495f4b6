"""Pauses of the garbage collector while many objects are made that all stay."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


MANY = 10_000
"""New objects among which the collector looks for garbage less soon: those of its first and second generation at once."""


@contextlib.contextmanager
def collector_paused() -> Iterator[None]:
    """Do not look for reference cycles: among many new objects that all stay, it takes as long as the work itself.

    Many new objects count as old at the end: the collector would go through all of them at once. It still finds the
    cycles among them, when it next looks at all there is.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            if gc.get_count()[0] >= MANY and gc.get_freeze_count() == 0:  # what is frozen would not stay so
                gc.freeze()
                gc.unfreeze()
            gc.enable()
