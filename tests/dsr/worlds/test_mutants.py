"""The tests of worlds can fail: each of these wrong designs is caught by the random histories, within a fixed few."""

from __future__ import annotations

from typing import Any
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import run_state_machine_as_test

from dsr.graph.sharing import Sharing
from dsr.memory import Memory
from dsr.worlds import opened
from dsr.worlds.fork import ForkedGraph
from dsr.worlds.fork_frames import ForkedFrames
from dsr.worlds.layer import Layer
from dsr.worlds.opened import Worlds
from dsr.worlds.overlay import Overlay
from dsr.worlds.overlay_frames import OverlayFrames
from dsr.worlds.registry import WorldInfo
from tests.dsr.conftest import Net
from tests.dsr.properties import test_worlds as random_worlds
from tests.dsr.properties.test_mutants import FIXED, Check, Mutant, do_nothing, is_caught
from tests.dsr.worlds import test_fork_model, test_overlay_model, test_worlds

QUICK = settings(FIXED, max_examples=300, stateful_step_count=30)


def networks() -> None:
    """Worlds of several processes."""
    run_state_machine_as_test(random_worlds.Worlds, settings=QUICK)


@QUICK
@given(st.lists(test_fork_model.ACTIONS, max_size=12), st.lists(test_fork_model.ACTIONS, max_size=40))
def forks(before: list[tuple[int, ...]], after: list[tuple[int, ...]]) -> None:
    """Forks of random graphs."""
    test_fork_model.history(before, after)


@QUICK
@given(st.lists(test_overlay_model.ACTIONS, max_size=40), st.booleans())
def overlays(actions: list[tuple[int, ...]], late: bool) -> None:
    """Overlays of random graphs."""
    test_overlay_model.history(actions, late)


def late_writer() -> None:
    """Who has not heard that a world was deleted and made again goes on writing into it."""
    test_worlds.test_a_world_that_is_made_again_begins_without_what_a_late_writer_wrote(Net())


def one_channel(original: Any) -> Any:
    """A world made under the name of a deleted one meets those who still write into that."""

    def to_attribute(info: WorldInfo, channel: str) -> str:
        return str(original(info, info.name))

    return to_attribute


def same_everywhere(_: Any) -> Any:
    """A replica has the same id in all worlds, and uses counters twice."""
    return lambda worlds: worlds.base.rid


def whatever_it_looks_through_to(_: Any) -> Any:
    """An overlay and another world of one name, made at once, are taken for one."""
    return property(lambda info: None)


def none_below(_: Any) -> Any:
    """What an answer tells to be gone is not hidden, if it is the parent's."""
    return lambda graph, rid, first, last: ()


MUTANTS: list[tuple[Check, Any, str, Mutant]] = [
    (late_writer, opened, "to_attribute", one_channel),
    (networks, Memory, "drop", do_nothing),
    (networks, Memory, "move", do_nothing),
    (networks, WorldInfo, "looks_through_to", whatever_it_looks_through_to),
    (forks, ForkedGraph, "take_over", do_nothing),
    (forks, Sharing, "entry_copied", do_nothing),
    (forks, ForkedFrames, "take_over", do_nothing),
    (overlays, Overlay, "below_came", do_nothing),
    (overlays, Overlay, "below_went", do_nothing),
    (overlays, Overlay, "below_changed", do_nothing),
    (overlays, Overlay, "hidden", do_nothing),
    (overlays, Sharing, "dots_between", none_below),
    (overlays, Overlay, "_outdate", do_nothing),
    (overlays, Layer, "bury", do_nothing),
    (overlays, OverlayFrames, "take_over", do_nothing),
]


@pytest.mark.parametrize(
    ("check", "target", "name", "mutant"), MUTANTS, ids=[f"{m.__name__}-{t.__name__}.{n}" for _, t, n, m in MUTANTS]
)
def test_it_is_caught(check: Check, target: Any, name: str, mutant: Mutant) -> None:
    with mock.patch.object(target, name, mutant(getattr(target, name))):
        assert is_caught(check)


@pytest.mark.parametrize("check", [late_writer, forks, overlays])
def test_without_a_mutation_nothing_is_wrong(check: Check) -> None:
    assert not is_caught(check)


def test_a_counter_that_is_used_twice_is_caught() -> None:
    """Two worlds of one replica id: what one of them has seen, the other takes for seen."""
    with mock.patch.object(Worlds, "_new_rid", same_everywhere(None)):
        assert is_caught(networks)
