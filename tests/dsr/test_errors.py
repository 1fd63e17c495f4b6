"""Suggestions at the end of error messages: what may be a misspelling of what."""

from __future__ import annotations

import difflib

import pytest

from dsr.errors import closest, suggest

CUBES = ("cube_3", "cube_4", "cube_6", "table")


@pytest.mark.parametrize("name", ["cube_99", "cube_33", "cube_5", "cube_", "cub", "cube"])
def test_a_number_is_no_misspelling_of_another_nor_to_be_guessed(name: str) -> None:
    assert closest(name, CUBES) == ""
    assert suggest(name, CUBES) == "valid: cube_3, cube_4, cube_6, table"


@pytest.mark.parametrize("name", ["cub_3", "cube3", "cube_03", "Cube_3", "cbue_3"])
def test_a_misspelt_word_with_the_right_number_is_recognised(name: str) -> None:
    assert suggest(name, CUBES) == "did you mean 'cube_3'?"


@pytest.mark.parametrize(
    ("name", "valid", "found"),
    [
        ("hand2", ("hand", "arm"), "hand"),
        ("huma_hand", ("human_hand_0", "table"), "human_hand_0"),
        ("huma_hand", ("human_hand_0", "human_hand_1"), ""),
        ("gen4", ("gen3", "none"), ""),
        ("a1_b2", ("a1_b3", "a1_bb2"), ""),
        ("a1_b2", ("a2_bb1", "a1_bb2"), "a1_bb2"),
        ("204", ("240", "24"), ""),
        ("cube_" + "9" * 5000, ("cube_9",), ""),
    ],
)
def test_the_closest_name(name: str, valid: tuple[str, ...], found: str) -> None:
    assert closest(name, valid) == found


def test_names_that_differ_in_the_number_only_are_listed_first() -> None:
    names = [*(f"a_{number}" for number in range(20)), "zebra_1", "zebra_2"]
    assert suggest("zebra_7", names, most=3) == "valid: zebra_1, zebra_2, a_0 and 19 more"


def test_without_valid_names() -> None:
    assert suggest("cube_3", ()) == "none is known"


def test_what_is_far_too_long_is_compared_with_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody may ask for a name of a million letters, again and again."""
    monkeypatch.setattr(difflib, "get_close_matches", lambda *_, **__: pytest.fail("compared"))
    assert closest("cube_3" * 10, CUBES) == ""
