"""Times, rates and percentiles; all stamps are comparable between the processes of one machine."""

from __future__ import annotations

import statistics
import threading
from collections.abc import Callable, Sequence

import numpy as np

from dsr.clock import WALL_CLOCK

monotonic = WALL_CLOCK.monotonic
"""s since boot: CLOCK_MONOTONIC, which all processes share."""


def sleep(seconds: float) -> None:
    """Wait."""
    WALL_CLOCK.wait(threading.Event(), seconds)


def sleep_until(deadline: float) -> None:
    """Wait until `monotonic` says `deadline`, s."""
    remaining = deadline - monotonic()
    if remaining > 0:
        sleep(remaining)


def duration(work: Callable[[], object]) -> float:
    """How long `work` takes, s."""
    start = monotonic()
    work()
    return monotonic() - start


def rate(loop: Callable[[], object], operations: int, runs: int) -> float:
    """Operations per second: the median of `runs` calls of `loop`, each of which does `operations`."""
    loop()
    return operations / statistics.median(duration(loop) for _ in range(runs))


def percentile(samples: Sequence[float], share: float) -> float:
    """The value that the share (0 to 1) of the samples does not exceed."""
    return float(np.quantile(samples, share))
