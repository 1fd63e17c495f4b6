"""Pauses of the garbage collector while many objects are made that all stay."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def collector_paused() -> Iterator[None]:
    """Do not look for reference cycles: among many new objects that all stay, it takes as long as the work itself.

    Many new objects count as old at the end: else the collector would go through all of them at once. It finds the
    cycles among them when it next looks at all there is.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            _let_many_be_old()
            gc.enable()


def _let_many_be_old() -> None:
    """Count new objects as old if the collector would otherwise have gone through its second generation meanwhile."""
    new, older, _ = gc.get_threshold()
    if gc.get_count()[0] >= new * older and gc.get_freeze_count() == 0:  # what somebody has frozen stays frozen
        gc.freeze()
        gc.unfreeze()
