"""Hypotheses as values: no object is in two places."""

from __future__ import annotations

from simulation_handler.explaining.hypotheses import Hypothesis, Move


def test_what_one_move_takes_along_no_other_does() -> None:
    hypothesis = Hypothesis().with_move(Move("a", moved_along=("b", "c"))).with_move(Move("d", beneath=("c",)))
    assert hypothesis.moves == (Move("a", moved_along=("b",)), Move("d", beneath=("c",)))


def test_a_new_move_of_the_same_object_replaces_the_old_one() -> None:
    hypothesis = Hypothesis().with_move(Move("a")).with_move(Move("a", held=True))
    assert hypothesis.moves == (Move("a", held=True),)


def test_what_moves_along_was_neither_removed_nor_did_it_fall() -> None:
    hypothesis = Hypothesis().with_removed(["b"]).with_fall("c", 1).with_move(Move("a", moved_along=("b", "c")))
    assert hypothesis == Hypothesis(moves=(Move("a", moved_along=("b", "c")),))
    assert hypothesis.with_removed(["b"]).moves == (Move("a", moved_along=("c",)),)
    assert hypothesis.with_fall("c", 2).unseen == {"b", "c"}


def test_a_false_percept_is_no_move_and_a_move_no_false_percept() -> None:
    hypothesis = Hypothesis().with_move(Move("a")).without_percept("a")
    assert hypothesis == Hypothesis(kept=frozenset({"a"}))
    assert hypothesis.with_move(Move("a")) == Hypothesis(moves=(Move("a"),))
