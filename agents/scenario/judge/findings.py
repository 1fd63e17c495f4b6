"""The common parts of all judgements: their time and objects, and how findings are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from agents.scenario.format.expectations import (
    EXACT,
    ActionsCheck,
    Attribute,
    BeliefError,
    Check,
    Edges,
    Expectation,
    Inside,
    KnownIn,
    OfObjects,
    SurprisesCheck,
    Windowed,
    WorldsCheck,
)
from agents.scenario.judge.overload import moment
from agents.scenario.judge.perturbations import event_end
from agents.scenario.truth.history import History, Sample
from dsr.network.keys import BASE

WithWindow = Windowed | BeliefError | Edges | SurprisesCheck | Inside | ActionsCheck | KnownIn | WorldsCheck
Finding = tuple[bool, str]
"""Whether an expectation holds, and the finding in words."""
NOTHING: Finding = (False, "there was no object to judge")


def describe(check: Check) -> str:
    """The expectation in a line, e.g. `resting (tolerance 1 mm)`."""
    details = [f"{key} {_written(check, key, value)}" for key, value in _stated(check)]
    name = str(check.__struct_config__.tag)
    return f"{name} ({', '.join(details)})" if details else name


def time_of(check: Expectation, history: History) -> float | None:
    """When it is judged, s after the start; None if the event that it counts from has not ended.

    Time in which an overloaded machine brought no frame does not count.
    """
    if check.event is None:
        return history.end if check.at is None else check.at
    end = event_end(history, check.event)
    return None if end is None or check.at is None else moment(history, end, check.at, history.end)


def begin_of(check: WithWindow, history: History, default: float | None) -> float | None:
    """Begin of the check's window, s after the start; `default` if the file does not say and the check follows no
    event.
    """
    if check.event is None:
        return default if check.after is None else check.after
    end = event_end(history, check.event) or 0.0
    if check.after is None:
        return end if isinstance(check, Windowed | SurprisesCheck | ActionsCheck) else None
    return moment(history, end, check.after, history.end)


def samples_of(check: Windowed, history: History) -> Sequence[Sample]:
    """The samples of its window."""
    begin, end = begin_of(check, history, history.scenario.settle), time_of(check, history)
    return [] if begin is None or end is None else history.window(begin, end)


def names_of(check: OfObjects, sample: Sample) -> Sequence[str]:
    """Names of the objects that the check is about."""
    return list(sample.truth) if check.objects is None else check.objects


def each(check: OfObjects, sample: Sample, find: Callable[[str], Finding]) -> Finding:
    """The findings about all objects of the check, the failed ones first; without any object it does not hold."""
    names = names_of(check, sample)
    if not names:
        return NOTHING
    findings = sorted(((name, *find(name)) for name in names), key=lambda finding: finding[1])
    return all(ok for _, ok, _ in findings), "; ".join(f"{name}: {what}" for name, _, what in findings)


def pairs(found: Iterable[tuple[str, str]]) -> str:
    """Relations in a line."""
    return ", ".join(f"{src} -> {dst}" for src, dst in sorted(found)) or "none"


def mm(metres: float) -> str:
    """A length in millimetres."""
    return f"{metres * 1000:.2f} mm"


def _stated(check: Check) -> Iterable[tuple[str, Any]]:
    """The fields that say something: not those left out, nor what counts of a window when all of it does."""
    unsaid = {"at_rest": False, "share": 1.0, **({"tolerance": EXACT} if isinstance(check, Attribute) else {})}
    fields = ((field, getattr(check, field)) for field in check.__struct_fields__)
    return ((key, value) for key, value in fields if value not in (None, (), BASE) and unsaid.get(key) != value)


def _written(check: Check, key: str, value: Any) -> str:
    if key in ("at", "after", "within"):
        return f"{value:g} s"
    if key == "share":
        return f"{value:.0%}"
    if key == "tolerance":  # of an attribute it is in the unit of that
        return f"{value:g}" if isinstance(check, Attribute) else mm(value)
    if key == "angle":
        return f"{math.degrees(value):g} deg"
    if isinstance(value, tuple):
        return ", ".join(" -> ".join(item) if isinstance(item, tuple) else str(item) for item in value)
    return str(value).lower() if isinstance(value, bool) else str(value)
