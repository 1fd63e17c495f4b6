"""Holders are compared by where hands are: the numbers of a hand tracker are its own."""

from __future__ import annotations

import pytest

from agents.scenario.truth.history import Sample
from benchmarks.honesty.hands import NOBODY, by_true_hands, nearest
from benchmarks.honesty.watching import ToldWorlds
from dsr.math3d.quaternions import Vector3
from simulation_handler.contact.relations import Relation

LEFT, RIGHT = (0.3, 0.2, 0.1), (0.3, -0.2, 0.1)


def near(place: Vector3) -> Vector3:
    return (place[0] + 0.01, place[1] - 0.02, place[2])


def holders(
    *moments: tuple[dict[str, Vector3], dict[str, Vector3], dict[Relation, float]],
) -> list[dict[Relation, float]]:
    """Who holds what by true hands, of moments at which there are these true hands, nodes and holders by node."""
    trues = [{name: (at,) * 21 for name, at in true.items()} for true, _, _ in moments]
    samples = [Sample(time=float(k), truth={}, hands=hands) for k, hands in enumerate(trues)]
    told = {float(k): ToldWorlds({}, {}, {"grasping": held}, palms) for k, (_, palms, held) in enumerate(moments)}
    return [told.relations["grasping"] for told in by_true_hands(samples, told).values()]


def test_a_node_is_the_hand_that_is_there_whatever_its_number() -> None:
    held = {("human_hand_0", "cup"): 0.9, ("human_hand_1", "cup"): 0.1, ("gripper", "box"): 1.0}
    true, nodes = {"human_hand_0": LEFT, "human_hand_1": RIGHT}, {"human_hand_0": near(RIGHT), "human_hand_1": LEFT}
    (found,) = holders((true, nodes, held))
    assert found == {("human_hand_1", "cup"): 0.9, ("human_hand_0", "cup"): 0.1, ("gripper", "box"): 1.0}


def test_a_node_that_is_seen_no_more_stays_the_hand_that_it_was() -> None:
    held = {("human_hand_0", "cup"): 0.9}
    seen = ({"human_hand_1": RIGHT}, {"human_hand_0": near(RIGHT)}, held)
    found = holders(seen, ({}, {}, held), ({"human_hand_1": RIGHT, "human_hand_0": LEFT}, {}, held))
    assert found == [{("human_hand_1", "cup"): 0.9}] * 3


def test_one_hand_is_one_node_the_one_that_was_seen_there_last() -> None:
    held = {("human_hand_0", "cup"): 0.7, ("human_hand_1", "cup"): 0.3}
    first = ({"human_hand_0": LEFT}, {"human_hand_0": LEFT}, held)
    then = ({"human_hand_0": LEFT}, {"human_hand_1": near(LEFT)}, held)
    false = ({"human_hand_0": LEFT}, {"human_hand_0": LEFT, "human_hand_1": RIGHT}, held)
    before = [{("human_hand_0", "cup"): 0.7, ("human_hand_1", "cup"): 0.3}]
    one = {("human_hand_0", "cup"): 0.3, (NOBODY, "cup"): 0.7}
    assert holders(first, then) == [*before, one]
    assert holders(false) == [{("human_hand_0", "cup"): 0.7, (NOBODY, "cup"): 0.3}]


def test_hands_side_by_side_are_told_apart_together() -> None:
    """The nearest hand of each alone would be the same one."""
    true = {"a": (0.0, 0.0, 0.0), "b": (0.1, 0.0, 0.0)}
    told = {"human_hand_0": (0.06, 0.0, 0.0), "human_hand_1": (0.16, 0.0, 0.0)}
    assert nearest(told, true) == {"human_hand_0": "a", "human_hand_1": "b"}
    assert nearest({}, true) == nearest(told, {}) == {}


def test_what_several_nodes_tell_of_one_hand_adds_up() -> None:
    held = {("human_hand_0", "cup"): 0.25, ("human_hand_1", "cup"): 0.5}
    (found,) = holders(({}, {"human_hand_0": LEFT, "human_hand_1": RIGHT}, held))
    assert found == {(NOBODY, "cup"): pytest.approx(0.75)}
