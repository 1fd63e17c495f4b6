"""What follows from the changes of an explanation."""

from __future__ import annotations

import pytest

from dsr.vocabulary.explained import changes_of
from simulation_handler.explaining.wording import is_lasting, moved_together


@pytest.mark.parametrize(
    ("text", "together"),
    [
        ("moved_with_supports(a; b, c)", {"a": {"b", "c"}}),
        ("held_moved_with_supports(a; b) & moved_alone(d)", {"a": {"b"}}),
        ("moved_with_contents(a; b) & put_back_under(c, e; d)", {"a": {"b"}, "d": {"c", "e"}}),
        ("moved_alone(a) & removed(b)", {}),
    ],
)
def test_what_moved_together(text: str, together: dict[str, set[str]]) -> None:
    assert moved_together(changes_of({}, text)) == together


@pytest.mark.parametrize(
    ("text", "lasts"),
    [
        ("nothing_changed()", True),
        ("false_percept(a) & false_percept(b)", True),
        ("false_percept(a) & moved_alone(b)", False),
        ("camera_moved()", False),
    ],
)
def test_what_leaves_the_belief_as_it_is_goes_on(text: str, lasts: bool) -> None:
    assert is_lasting(changes_of({}, text)) == lasts
