"""Forks of random graphs, changed at random with their parents: always a deep copy and what was done to it."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.dsr.worlds.copies import World, act, fill

ACTIONS = st.tuples(st.integers(0, 15), st.integers(0, 5), st.integers(0, 5), st.integers(0, 5), st.integers(0, 7))
"""(what, in which world, and three numbers)"""


@settings(max_examples=150, deadline=None)
@given(st.lists(ACTIONS, max_size=12), st.lists(ACTIONS, max_size=40))
def test_a_fork_is_a_deep_copy(before: list[tuple[int, ...]], after: list[tuple[int, ...]]) -> None:
    history(before, after)


def history(before: list[tuple[int, ...]], after: list[tuple[int, ...]]) -> None:
    """What is done before there is a fork, and then; checked after each action."""
    worlds = [World.plain("base")]
    fill(worlds[0])
    for what, _, *numbers in before:
        act(worlds[0], what, *numbers)
    worlds.append(worlds[0].fork("fork"))
    for what, where, *numbers in after:
        world = worlds[where % len(worlds)]
        if what == 15 and len(worlds) < 5:
            worlds.append(world.fork(f"fork{len(worlds)}"))
        act(world, what, *numbers)
        for each in worlds:
            each.check()
    for each in worlds:
        each.check_frames()
