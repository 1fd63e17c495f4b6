"""Pauses of the garbage collector: what is made meanwhile, and who else has changed the collector."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator

import pytest

from dsr.replication.collector import collector_paused

_FEW = 100


@pytest.fixture(autouse=True)
def _collector() -> Iterator[None]:
    """Begin with nothing new and nothing frozen, and leave the collector as it was."""
    gc.unfreeze()
    gc.collect()
    yield
    gc.unfreeze()
    gc.enable()


def _many() -> int:
    new, older, _ = gc.get_threshold()
    return 2 * new * older


def _made(count: int) -> list[list[int]]:
    with collector_paused():
        assert not gc.isenabled()
        return [[number] for number in range(count)]


def _generation(thing: object) -> int:
    return next(number for number in range(3) if any(thing is other for other in gc.get_objects(generation=number)))


class _Ring:
    """Something that holds itself."""

    def __init__(self) -> None:
        self.itself = self


def test_many_new_objects_count_as_old_at_once() -> None:
    made = _made(_many())
    assert gc.isenabled()
    assert _generation(made[-1]) == 2


def test_few_new_objects_stay_young() -> None:
    assert _generation(_made(_FEW)[-1]) < 2


def test_a_cycle_that_was_made_meanwhile_is_found_later() -> None:
    with collector_paused():
        ring = _Ring()
        watched = weakref.ref(ring)
        kept = [[number] for number in range(_many())]
        del ring
    assert len(kept) == _many()
    assert watched() is not None
    gc.collect()
    assert watched() is None


def test_what_somebody_has_frozen_stays_frozen() -> None:
    gc.freeze()
    frozen = gc.get_freeze_count()
    made = _made(_many())
    assert gc.get_freeze_count() >= frozen - len(made) // 10  # some of it was given back since
    assert _generation(made[-1]) < 2


def test_a_collector_that_was_off_stays_off() -> None:
    gc.disable()
    _made(_many())
    assert not gc.isenabled()
