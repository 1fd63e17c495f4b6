"""Overlays of random graphs, on two replicas with messages lost, repeated and late: always what the definition says."""

from __future__ import annotations

from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.dsr.worlds.copies import NAMES, shown
from tests.dsr.worlds.layers import Network

ACTIONS = st.tuples(st.integers(0, 11), st.integers(0, 3), st.integers(0, 5), st.integers(0, 5), st.integers(0, 15))
"""(what, in which graph, and three numbers)"""


@settings(max_examples=150, deadline=None)
@given(st.lists(ACTIONS, max_size=40), st.booleans())
@example([(0, 3, 1, 0, 0), (0, 1, 1, 0, 0), (2, 0, 1, 0, 0), (8, 0, 0, 0, 0)], True)  # said of what is still to come
@example([(0, 0, 0, 0, 0)] * 13 + [(0, 1, 0, 0, 0), (1, 0, 0, 0, 0)], True)  # hidden by a reply, where it is taken
@example([(0, 0, 0, 0, 0), (0, 0, 0, 0, 0), (4, 0, 1, 0, 0), (11, 0, 0, 0, 0)], False)  # a cycle after a transform
@example([(0, 3, 0, 0, 0), (4, 0, 0, 0, 0), (8, 1, 0, 0, 0)], True)  # an edge of an incarnation that comes later
def test_an_overlay_shows_what_its_definition_says(actions: list[tuple[int, ...]], late: bool) -> None:
    history(actions, late)


def history(actions: list[tuple[int, ...]], late: bool) -> None:
    """What is done; `late` tells whether the second replica of the parent begins with nothing."""
    network = Network()
    for index in range(len(NAMES)):
        network.act(0, 2, index, 0, 1)
    for src, dst in ((0, 1), (1, 2), (0, 3), (3, 4)):
        network.act(4, 2, src, dst, 2)
    if not late:
        network.reply(1, upper=False)
    for what, *where in actions:
        network.act(what, *where)
        for place in network.places:
            place.check(frames=what == 11)
    network.make_durable()
    for place in network.places:
        place.check(frames=True)
    a, b = (place.overlay for place in network.places)
    assert shown(a) == shown(b) and a.store.context == b.store.context and a.store.fingerprint == b.store.fingerprint
