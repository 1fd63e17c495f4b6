"""Changes that an explanation tells, as text for people and as an attribute for programs."""

from __future__ import annotations

import pytest

from dsr.vocabulary.explained import ATTRIBUTE, ExplainedChange, changes_of, encoded, text_of

CHANGES = (
    ExplainedChange("camera_moved"),
    ExplainedChange("moved_with_supports", (("cube_3",), ("cube_4", "cube_5"))),
    ExplainedChange("swapped", (("a", "b"),)),
)


def test_changes_are_told_in_a_line() -> None:
    assert text_of(CHANGES) == "camera_moved() & moved_with_supports(cube_3; cube_4, cube_5) & swapped(a, b)"


def test_changes_travel_as_an_attribute_whatever_the_text_says() -> None:
    assert changes_of({ATTRIBUTE: encoded(CHANGES)}, "removed(cube_1)") == CHANGES


def test_older_recordings_have_only_the_text() -> None:
    assert changes_of({}, text_of(CHANGES)) == CHANGES


@pytest.mark.parametrize("written", ["", "no JSON", "3", '[["moved", 3]]', "[[1, []]]", "[[]]"])
def test_a_malformed_attribute_tells_no_changes(written: str) -> None:
    assert changes_of({ATTRIBUTE: written}) == ()
