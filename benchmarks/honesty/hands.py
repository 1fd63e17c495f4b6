"""Which true hand a node is: a hand tracker numbers hands as it sees them, and not as the scene does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from agents.hand_tracker.sighting import PALM
from agents.scenario.truth.history import Sample
from benchmarks.honesty.watching import ToldWorlds
from dsr.math3d.quaternions import Vector3
from simulation_handler.contact.relations import Relation
from simulation_handler.worlds.model import GRASPING

NOBODY = "no true hand"
"""Stands for a node that never was where a true hand is"""


def by_true_hands(samples: Sequence[Sample], worlds: Mapping[float, ToldWorlds]) -> dict[float, ToldWorlds]:
    """What is told at the times (s) of samples, with the holders by the names of the true hands.

    A node is the true hand that was there when the node was seen last, and that no other node was since then.
    """
    hands: dict[str, str] = {}
    named: dict[float, ToldWorlds] = {}
    for sample in samples:
        if (told := worlds.get(sample.time)) is not None:
            seen = nearest(told.palms, {name: _palm(landmarks) for name, landmarks in sample.hands.items()})
            before = {node: hand for node, hand in hands.items() if hand not in seen.values()}
            hands = dict.fromkeys(hands.keys() | told.palms.keys(), NOBODY) | before | seen
            holders = _renamed(told.relations[GRASPING], hands)
            named[sample.time] = told._replace(relations={**told.relations, GRASPING: holders})
    return named


def nearest(told: Mapping[str, Vector3], true: Mapping[str, Vector3]) -> dict[str, str]:
    """Which true hand each node is, by their places (m): those pairs whose squared distances have the least sum."""
    if not told or not true:
        return {}
    nodes, hands = sorted(told), sorted(true)
    apart = np.array([told[node] for node in nodes])[:, None] - np.array([true[hand] for hand in hands])
    rows, columns = linear_sum_assignment((apart**2).sum(axis=-1))
    return {nodes[row]: hands[column] for row, column in zip(rows.tolist(), columns.tolist(), strict=True)}


def _palm(landmarks: Sequence[Vector3]) -> Vector3:
    x, y, z = np.mean([landmarks[index] for index in PALM], axis=0).tolist()
    return x, y, z


def _renamed(holders: Mapping[Relation, float], hands: Mapping[str, str]) -> dict[Relation, float]:
    """Pairs (holder, object) with their probability; what is told of several nodes of one hand adds up."""
    named: dict[Relation, float] = {}
    for (holder, name), told in holders.items():
        pair = hands.get(holder, holder), name
        named[pair] = named.get(pair, 0.0) + told
    return named
