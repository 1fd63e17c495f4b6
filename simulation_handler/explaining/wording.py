"""Describes a hypothesis as changes: `moved_with_supports(cube_3; cube_4)`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from dsr.perception.scales import SAME_PLACE
from dsr.vocabulary.explained import (
    APPEARED,
    CAMERA_MOVED,
    FALSE_PERCEPT,
    FELL,
    HELD,
    HELD_TOO,
    MOVED,
    NOTHING_CHANGED,
    PUT_ON,
    RELATION_ENDED,
    REMOVED,
    SWAPPED,
    TURNED,
    UNDER,
    WITH_CONTENTS,
    WITH_SUPPORTS,
    ExplainedChange,
)
from simulation_handler.contact.placement import find_support
from simulation_handler.explaining.camera import corrected
from simulation_handler.explaining.hypotheses import Hypothesis, Move
from simulation_handler.explaining.search import Candidate
from simulation_handler.explaining.situation import Situation
from simulation_handler.shapes.geometry import Solid

_LASTING = (FALSE_PERCEPT, NOTHING_CHANGED)  # kinds that leave the belief as it is, so that their cause goes on


def describe(situation: Situation, candidate: Candidate) -> tuple[ExplainedChange, ...]:
    """The changes of a hypothesis."""
    hypothesis = candidate.hypothesis
    situation = corrected(situation, hypothesis)
    swaps = _swaps(situation, hypothesis, candidate.settled)
    swapped = {name for pair in swaps for name in pair}
    changes = [ExplainedChange(CAMERA_MOVED)] if hypothesis.camera_moved else []
    changes += [ExplainedChange(SWAPPED, (pair,)) for pair in swaps]
    changes += [_move(situation, move, candidate) for move in hypothesis.moves if move.name not in swapped]
    changes += [ExplainedChange(REMOVED, ((name,),)) for name in sorted(hypothesis.removed)]
    changes += [ExplainedChange(FELL, ((name,),)) for name, _ in hypothesis.fallen]
    changes += [ExplainedChange(FALSE_PERCEPT, ((name,),)) for name in sorted(hypothesis.kept)]
    return tuple(changes) or (ExplainedChange(NOTHING_CHANGED),)


def is_lasting(changes: Iterable[ExplainedChange]) -> bool:
    """Whether an explanation leaves the belief as it is."""
    return all(change.kind in _LASTING for change in changes)


def moved_together(changes: Iterable[ExplainedChange]) -> dict[str, frozenset[str]]:
    """The objects that moved together with each seen object, by an explanation."""
    found = {}
    for change in changes:
        kind = change.kind.removeprefix(HELD_TOO)
        if len(change.groups) == 2 and kind in (WITH_SUPPORTS, WITH_CONTENTS):
            found[change.groups[0][0]] = frozenset(change.groups[1])
        elif len(change.groups) == 2 and kind == UNDER:
            found[change.groups[1][0]] = frozenset(change.groups[0])
    return found


def _move(situation: Situation, move: Move, candidate: Candidate) -> ExplainedChange:
    name = move.name
    hand = HELD_TOO if move.held else ""
    if name not in situation.believed:
        return ExplainedChange(f"{hand}{APPEARED}", ((name,),))
    if move.moved_along:
        above = set(situation.chain_above(name))
        kind = WITH_CONTENTS if set(move.moved_along) <= above else WITH_SUPPORTS
        return ExplainedChange(f"{hand}{kind}", ((name,), move.moved_along))
    if move.beneath:
        return ExplainedChange(UNDER, (tuple(reversed(move.beneath)), (name,)))
    return ExplainedChange(HELD, ((name,),)) if move.held else _alone(situation, name, candidate)


def _alone(situation: Situation, name: str, candidate: Candidate) -> ExplainedChange:
    if _has_fallen(situation, name, candidate):
        return ExplainedChange(FELL, ((name,),))
    before = set(situation.beneath.get(name, ())) - set(situation.fixtures)
    placement = candidate.drafted.placements.get(name)
    after = set(placement.supports if placement else ()) - set(situation.fixtures)
    if after - before:
        return ExplainedChange(PUT_ON, ((name, *sorted(after)),))
    if before - after:
        return ExplainedChange(RELATION_ENDED, ((name, *sorted(before - after)),))
    moved = math.dist(situation.believed[name].position[:2], situation.seen[name].percept.position[:2])
    return ExplainedChange(MOVED if moved > SAME_PLACE else TURNED, ((name,),))


def _has_fallen(situation: Situation, name: str, candidate: Candidate) -> bool:
    """Whether an object is lower now, and nothing would carry it any more where it was."""
    before, reach = situation.believed[name], situation.config.hover_tolerance
    if candidate.settled[name].bottom > before.bottom - reach:
        return False
    others = [solid for other, solid in candidate.settled.items() if other != name]
    return not find_support(before, before.bottom, [*situation.fixtures.values(), *others], reach)[0]


def _swaps(situation: Situation, hypothesis: Hypothesis, settled: Mapping[str, Solid]) -> list[tuple[str, str]]:
    """Pairs that each are where the other one was."""
    names = [move.name for move in hypothesis.moves if move.name in situation.believed and not move.moved_along]
    return [
        (a, b)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if _is_near(settled[a], situation.believed[b]) and _is_near(settled[b], situation.believed[a])
    ]


def _is_near(a: Solid, b: Solid) -> bool:
    return math.dist(a.position, b.position) < SAME_PLACE
