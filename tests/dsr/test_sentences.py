"""Explanations as sentences, of all kinds and of what no sentence is known for."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.vocabulary import explained
from dsr.vocabulary.explained import HELD_TOO, KINDS, ExplainedChange, changes_of, encoded, text_of
from dsr.vocabulary.sentences import Rejected, explained_sentence, listed, rejected_sentences, sentence_of

NAMES = st.text("abc_123", min_size=1, max_size=4)
CHANGES = st.builds(
    ExplainedChange, st.sampled_from((*KINDS, f"{HELD_TOO}appeared", "unheard_of")),
    st.lists(st.lists(NAMES, max_size=3).map(tuple), max_size=3).map(tuple),
)  # fmt: skip


@pytest.mark.parametrize(
    ("notation", "sentence"),
    [
        ("moved_alone(a)", "a moved"),
        ("moved_alone(a) & moved_alone(b) & moved_alone(c)", "a, b and c moved"),
        ("turned(a)", "a turned"),
        ("moved_with_supports(cube_3; cube_4)", "cube_3 moved, and cube_4 beneath it moved along"),
        ("moved_with_contents(tray; a, b)", "tray moved, and a and b in or on it moved along"),
        ("moved_with_supports(a; b) & moved_with_supports(c; d)",
         "a moved, and b beneath it moved along; c moved, and d beneath it moved along"),
        ("swapped(a, b)", "a and b changed places"),
        ("put_on(a, b)", "a stands on b now"),
        ("put_on(a, b, c)", "a stands on b and c now"),
        ("relation_ended(a, b)", "a does not stand on b any more"),
        ("put_back_under(b, c; a)", "b and c came beneath a"),
        ("placed_under(b; a)", "b came beneath a"),
        ("held(a)", "something holds a"),
        ("held_moved_with_supports(a; b)", "a moved, and b beneath it moved along; something holds a"),
        ("held_appeared(a)", "a appeared; something holds a"),
        ("fell(a) & moved_alone(c) & fell(b)", "a and b fell; c moved"),
        ("removed(a)", "a was taken away"),
        ("removed(a) & removed(b)", "a and b were taken away"),
        ("taken_along(a; hand)", "hand took a along"),
        ("appeared(a)", "a appeared"),
        ("false_percept(a)", "what was seen of a is false"),
        ("camera_moved() & moved_alone(a)", "a camera moved; a moved"),
        ("nothing_changed()", "nothing changed"),
        ("teleported(a; b)", "teleported(a; b)"),
        ("moved_with_supports(a)", "moved_with_supports(a)"),
        ("put_on(a)", "put_on(a)"),
        ("", ""),
    ],
)  # fmt: skip
def test_a_notation_is_told_as_a_sentence(notation, sentence):
    assert sentence_of(changes_of({}, notation)) == sentence


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_sentence(kind):
    shapes = ((), (("a",),), (("a", "b"),), (("a",), ("b",)))
    told = [sentence_of([ExplainedChange(kind, groups)]) for groups in shapes]
    assert any("(" not in sentence for sentence in told), told


def test_the_kinds_are_all_that_the_vocabulary_names():
    words = {value for name, value in vars(explained).items() if name.isupper() and isinstance(value, str)}
    assert {word for word in words if not word.endswith("_")} - {explained.ATTRIBUTE} == set(KINDS)


@given(st.lists(CHANGES, max_size=5))
def test_no_object_is_left_out(changes):
    sentence = sentence_of(changes)
    assert all(name in sentence for change in changes for group in change.groups for name in group)


@given(st.lists(CHANGES, max_size=4))
def test_the_event_tells_what_its_changes_do(changes):
    attributes = {"explanation": text_of(changes), "changes": encoded(tuple(changes))}
    assert explained_sentence(attributes) == (sentence_of(changes) or attributes["explanation"])


def test_what_is_no_change_is_told_as_it_is_written():
    assert explained_sentence({"explanation": "a ghost did it"}) == "a ghost did it"
    assert explained_sentence({"explanation": "a ghost did it", "changes": "[["}) == "a ghost did it"
    assert explained_sentence({}) == ""


def test_the_rejected_keep_their_scores():
    lines = "9.5 moved_alone(cube_3)\n12.0 a ghost did it\nlabel"
    assert rejected_sentences({"alternatives": lines}) == [
        Rejected("9.5", "cube_3 moved"),
        Rejected("12.0", "a ghost did it"),
        Rejected("label", ""),
    ]
    assert rejected_sentences({}) == []


@pytest.mark.parametrize(
    ("names", "text"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_names_are_listed(names, text):
    assert listed(names) == text
