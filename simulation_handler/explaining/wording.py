"""Says what a hypothesis means, in a form that people and programs can read: `moved_with_supports(cube_3; cube_4)`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from dsr.vocabulary.calibration import CAMERA_MOVED
from simulation_handler.explaining.camera import corrected
from simulation_handler.explaining.hypotheses import Hypothesis, Move
from simulation_handler.explaining.search import Candidate
from simulation_handler.explaining.situation import Situation
from simulation_handler.shapes.geometry import Solid

LASTING = ("false_percept", "nothing_changed")
"""Words of explanations that leave the belief as it is, so that what they explain goes on."""
_RIDERS = re.compile(r"moved_with_(?:supports|contents)\((?P<leader>[^;]+); (?P<riders>[^)]+)\)")
_PILE = re.compile(r"put_back_under\((?P<riders>[^;]+); (?P<leader>[^)]+)\)")
_SAME_PLACE = 0.015  # m
_BESIDE = 0.010  # m by which something moved, rather than only turned


def describe(situation: Situation, candidate: Candidate) -> str:
    """The changes of a hypothesis, joined by `&`."""
    hypothesis = candidate.hypothesis
    situation = corrected(situation, hypothesis)
    swaps = _swaps(situation, hypothesis, candidate.settled)
    swapped = {name for pair in swaps for name in pair}
    parts = [CAMERA_MOVED] if hypothesis.camera_moved else []
    parts += [f"swapped({a}, {b})" for a, b in swaps]
    parts += [_move(situation, move, candidate) for move in hypothesis.moves if move.name not in swapped]
    parts += [f"removed({name})" for name in sorted(hypothesis.removed)]
    parts += [f"fell({name})" for name, _ in hypothesis.fallen]
    parts += [f"false_percept({name})" for name in sorted(hypothesis.kept)]
    return " & ".join(parts) or "nothing_changed()"


def is_lasting(text: str) -> bool:
    """Whether an explanation, in these words, leaves the belief as it is."""
    return all(part.startswith(LASTING) for part in text.split(" & "))


def moved_together(text: str) -> dict[str, frozenset[str]]:
    """Read from an explanation's words which objects moved together with which seen object."""
    found = (*_RIDERS.finditer(text), *_PILE.finditer(text))
    return {match["leader"]: frozenset(match["riders"].split(", ")) for match in found}


def _move(situation: Situation, move: Move, candidate: Candidate) -> str:
    name = move.name
    hand = "held_" if move.held else ""
    if name not in situation.believed:
        return f"{hand}appeared({name})"
    if move.riders:
        above = set(situation.chain_above(name))
        what = "contents" if set(move.riders) <= above else "supports"
        return f"{hand}moved_with_{what}({name}; {', '.join(move.riders)})"
    if move.beneath:
        return f"put_back_under({', '.join(reversed(move.beneath))}; {name})"
    return f"held({name})" if move.held else _alone(situation, name, candidate)


def _alone(situation: Situation, name: str, candidate: Candidate) -> str:
    before = set(situation.beneath.get(name, ())) - set(situation.fixtures)
    placement = candidate.drafted.placements.get(name)
    after = set(placement.supports if placement else ()) - set(situation.fixtures)
    if after - before:
        return f"put_on({name}, {', '.join(sorted(after))})"
    if before - after:
        return f"relation_ended({name}, {', '.join(sorted(before - after))})"
    moved = math.dist(situation.believed[name].position[:2], situation.seen[name].percept.position[:2])
    return f"moved_alone({name})" if moved > _BESIDE else f"turned({name})"


def _swaps(situation: Situation, hypothesis: Hypothesis, settled: Mapping[str, Solid]) -> list[tuple[str, str]]:
    """Pairs that each are where the other one was."""
    names = [move.name for move in hypothesis.moves if move.name in situation.believed and not move.riders]
    return [
        (a, b)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if _is_near(settled[a], situation.believed[b]) and _is_near(settled[b], situation.believed[a])
    ]


def _is_near(a: Solid, b: Solid) -> bool:
    return math.dist(a.position, b.position) < _SAME_PLACE
