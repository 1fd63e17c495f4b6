"""From a hypothesis to a scene that can be simulated: everything where the hypothesis puts it, on contact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dsr.math3d import quaternions
from dsr.perception.scales import RESOLUTION
from simulation_handler.contact.depenetration import depenetrated
from simulation_handler.contact.perceived import PerceivedBody
from simulation_handler.contact.placement import Placement, place, separate
from simulation_handler.contact.stances import likeliest_stance
from simulation_handler.explaining.glimpses import Motion
from simulation_handler.explaining.hypotheses import FALLS, FROM_GLIMPSE, Hypothesis, Move
from simulation_handler.explaining.pushing import pushed
from simulation_handler.explaining.situation import Situation
from simulation_handler.perception.percepts import Array
from simulation_handler.scales import UNSEEN_SLACK, UNSEEN_VARIANCE
from simulation_handler.shapes.geometry import Solid

UNSEEN_COVARIANCE: Array = np.diag((RESOLUTION**2, RESOLUTION**2, UNSEEN_SLACK**2))
"""(3, 3) m^2, of where something unseen is: its height follows from what it is on"""


@dataclass(frozen=True)
class Draft:
    """The scene of a hypothesis before physics has looked at it."""

    solids: Mapping[str, Solid]
    """Solids of all objects with a place, by name."""
    placements: Mapping[str, Placement]
    """Placements of the objects that the hypothesis moves, by name."""
    held: frozenset[str]
    """Objects that do not fall: in a gripper, or held by something unknown."""
    motions: Mapping[str, Motion] = field(default_factory=dict)
    """Motions of the objects that do not begin at rest, by name."""
    pushed: frozenset[str] = frozenset()
    """Unseen objects that the moved ones pushed out of their way."""


def draft(situation: Situation, hypothesis: Hypothesis) -> Draft:
    """Put everything where the hypothesis has it, from the lowest object up, and out of each other's way."""
    motions = {name: motion for name, fall in hypothesis.fallen if (motion := _motion(situation, name, fall))}
    wanted = _wanted(situation, hypothesis) | {name: motion.solid for name, motion in motions.items()}
    aside: dict[str, Solid] = {}
    for _ in range(2):  # the second time with what the heights say about the rest of the positions, and what is aside
        placements = _placed(situation, hypothesis, wanted, aside)
        wanted = _aligned(situation, hypothesis, wanted, placements)
        aside = aside or pushed(situation, hypothesis, placements)
    gone = hypothesis.removed
    stay = {name: solid for name, solid in situation.believed.items() if name not in gone and name not in placements}
    stay |= aside
    solids = stay | {name: placement.solid for name, placement in placements.items()}
    still = {name: solid for name, solid in solids.items() if name not in motions}
    hovering = {name for name, placement in placements.items() if not placement.rests}
    held_moves = {name for move in hypothesis.moves if move.held for name in (move.name, *move.moved_along)}
    held = situation.held | (hovering & held_moves)
    solids |= _separated(situation, still, frozenset(placements), held)
    return Draft(solids, placements, frozenset(held), motions, frozenset(aside))


def _wanted(situation: Situation, hypothesis: Hypothesis) -> dict[str, Solid]:
    """Where each object that moved should be, before contact is looked for."""
    wanted: dict[str, Solid] = {}
    for move in hypothesis.moves:
        top = situation.seen[move.name].percept
        wanted[move.name] = top
        wanted |= {name: situation.carried(move.name, name) for name in move.moved_along}
        wanted |= _piled_under(situation, move, top)
    wanted |= {name: _tipped(situation, name, fall) for name, fall in hypothesis.fallen if fall < FROM_GLIMPSE}
    return wanted


def _motion(situation: Situation, name: str, direction: int) -> Motion | None:
    """How an object moved that fell from where it was last seen; None if it fell in one of the directions `FALLS`."""
    return situation.glimpsed[name].motion(direction - FROM_GLIMPSE) if direction >= FROM_GLIMPSE else None


def _tipped(situation: Situation, name: str, direction: int) -> Solid:
    """An object that has just tipped over the edge of its support."""
    solid = situation.believed[name]
    dx, dy = FALLS[direction]
    quarter = quaternions.from_rotvec((-0.5 * math.pi * dy, 0.5 * math.pi * dx, 0.0))
    ox, oy, _ = quaternions.rotate(solid.rotation, (dx * solid.size[0], dy * solid.size[1], 0.0))
    x, y, z = solid.position
    return solid.at((x + ox, y + oy, z), quaternions.product(solid.rotation, quarter))


def _piled_under(situation: Situation, move: Move, top: Solid) -> dict[str, Solid]:
    """What came from elsewhere, upright in a pile that reaches up to `top`."""
    pile: dict[str, Solid] = {}
    level = top.bottom
    for name in reversed(move.beneath):
        size = situation.size(name)
        before = situation.still_beneath(name, top) or top
        x, y, _ = before.position
        pile[name] = situation.solid(name, (x, y, level - 0.5 * size[2]), before.rotation)
        level -= size[2]
    return pile


def _placed(
    situation: Situation, hypothesis: Hypothesis, wanted: Mapping[str, Solid], aside: Mapping[str, Solid]
) -> dict[str, Placement]:
    """Onto contact, from the lowest up, among what stays and what was pushed `aside`."""
    scene = dict(situation.fixtures)
    scene |= {n: s for n, s in situation.believed.items() if n not in wanted and n not in hypothesis.removed}
    scene |= aside
    placements: dict[str, Placement] = {}
    falls = dict(hypothesis.fallen)
    for name, solid in sorted(wanted.items(), key=lambda item: (item[0] in falls, item[1].bottom, item[0])):
        seen = situation.seen.get(name)
        covariance = UNSEEN_COVARIANCE if seen is None else seen.covariance
        if name in falls and falls[name] >= FROM_GLIMPSE:
            glimpse = situation.glimpsed[name]
            clear = depenetrated(solid, scene.values(), -glimpse.ray)
            placements[name] = Placement(clear, (), glimpse.covariance)
        elif name in falls:
            placements[name] = Placement(solid, (), covariance)
        else:
            others = list(scene.values())
            turned = solid
            if seen is not None and not seen.shows_stance:
                there = PerceivedBody(solid, covariance, seen.turning)
                turned = solid.turned(likeliest_stance(there, others, situation.config))
            placements[name] = place(turned, covariance, others, situation.config)
        scene[name] = placements[name].solid
    return placements


def _aligned(
    situation: Situation, hypothesis: Hypothesis, wanted: Mapping[str, Solid], placements: Mapping[str, Placement]
) -> dict[str, Solid]:
    """What moves with a seen object shifted sideways as that was, once its height was known."""
    aligned = dict(wanted)
    for move in hypothesis.moves:
        before, after = wanted[move.name].position, placements[move.name].solid.position
        for name in (*move.moved_along, *move.beneath):
            if name in move.beneath and situation.still_beneath(name, wanted[move.name]):
                continue
            x, y, z = wanted[name].position
            aligned[name] = wanted[name].moved((x + after[0] - before[0], y + after[1] - before[1], z))
    return aligned


def _separated(
    situation: Situation, solids: Mapping[str, Solid], moved: frozenset[str], held: frozenset[str] | set[str]
) -> dict[str, Solid]:
    """Overlapping neighbours pushed apart; the unseen gives way to the seen, the moved to what stays."""
    softness = {name: _softness(situation, name, name in moved) for name in solids if name not in held}
    apart = separate([*situation.fixtures.values(), *solids.values()], softness, known=situation.pairs)
    return {name: solid.moved(apart[name]) if name in apart else solid for name, solid in solids.items()}


def _softness(situation: Situation, name: str, moved: bool) -> float:
    seen = situation.seen.get(name)
    return UNSEEN_VARIANCE if seen is None or not moved else float(np.trace(seen.covariance[:2, :2]))
