"""The steps of a history: work and faults in a random order that a seed decides, as plain data.

A step says all that happens in it. So a history can be run again, written down, and made shorter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

HOUR = 3600.0
DAY = 24 * HOUR
NAMES = ("a", "b", "c", "d", "e", "f")
WORLDS = ("u", "v", "w")
LONGEST_KILL = 60
"""calls of network or disk, beyond which no process waits for its death; a start with its disk makes about as many"""

_WORK = {
    "add": 12, "update": 14, "take away": 2, "edge": 10, "stream": 12, "remove": 6, "remove edge": 3, "batch": 3,
    "make": 8, "open": 8, "delete": 3, "add there": 7, "update there": 5, "remove there": 3,
    "mesh": 3, "ask for mesh": 3,
}  # fmt: skip
_FAULTS = {
    "lossy": 6, "partition": 3, "cut": 6, "mend": 2, "suspend": 4, "resume": 3, "kill": 6, "kill as it starts": 2,
    "power": 2, "blackout": 1, "start": 6, "full": 1, "room": 2, "errors": 1, "clock": 3, "right clock": 2, "offend": 5,
}  # fmt: skip
_PASSING = {"pass": 60}
_ALL = {**_WORK, **_FAULTS, **_PASSING}
"""How often each kind of step comes, relative to the others."""


class Step(NamedTuple):
    """One step: what is done, where, and two numbers whose meaning depends on what."""

    kind: str
    place: int = 0
    choice: int = 0
    amount: float = 0.0


def day(seed: int, number: int, steps: int) -> list[Step]:
    """The steps of one day of a history: work and faults, the healing of all, and a long sleep."""
    drawn = np.random.default_rng([seed, number])
    weights = np.array(list(_ALL.values()), dtype=float)
    kinds = drawn.choice(list(_ALL), size=steps, p=weights / weights.sum())
    sleep = Step("sleep", amount=float(drawn.uniform(0.5, 1.0)) * DAY)
    return [*(_drawn(drawn, str(kind)) for kind in kinds), Step("heal"), sleep]


def _drawn(drawn: np.random.Generator, kind: str) -> Step:
    amount = 0.0
    match kind:
        case "pass":
            amount = drawn.choice([0.0, 0.02, 0.1, 0.1, 0.3, 1.1])
        case "lossy":
            amount = drawn.choice([0.0, 0.1, 0.4])
        case "clock":
            amount = drawn.choice([-0.4, 0.4, drawn.uniform(-3 * HOUR, 3 * HOUR), -DAY * 365])
        case "kill" | "kill as it starts":
            amount = float(drawn.integers(LONGEST_KILL if drawn.random() < 0.5 else 6))
    return Step(kind, int(drawn.integers(60)), int(drawn.integers(1 << 16)), float(amount))
