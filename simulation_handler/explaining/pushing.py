"""What is seen to move pushes what nobody sees out of its way: along with it, step by step, as a slow push does."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

from dsr.perception.scales import SAME_OUTCOME
from simulation_handler.contact.containment import shifted_along
from simulation_handler.contact.placement import Placement, separate
from simulation_handler.explaining.hypotheses import Hypothesis
from simulation_handler.explaining.situation import Situation
from simulation_handler.perception.paths import between
from simulation_handler.shapes.geometry import Solid


def pushed(situation: Situation, hypothesis: Hypothesis, placements: Mapping[str, Placement]) -> dict[str, Solid]:
    """The unseen objects that a moved one would reach into, and what is on or in them, where they were pushed to.

    Args:
        situation: what is believed.
        hypothesis: what moved.
        placements: of the objects that the hypothesis moves, by name.
    """
    free = {
        name: solid
        for name, solid in situation.believed.items()
        if situation.is_unseen(name) and name not in placements and name not in hypothesis.removed
    }
    found: dict[str, Solid] = {}
    for move in hypothesis.moves:
        for name in (move.name, *move.moved_along):
            if name in situation.believed:
                there = tuple((free | found).values())
                found |= _pushed_by(situation.believed[name], placements[name].solid, there)
    on_or_in = [*situation.beneath.items(), *situation.inside.items()]
    relations = {(upper, lower) for upper, all_lower in on_or_in if upper in free for lower in all_lower}
    return found | shifted_along(found, free, relations)


@lru_cache
def _pushed_by(before: Solid, after: Solid, free: tuple[Solid, ...]) -> Mapping[str, Solid]:
    """Those of the free solids that a solid reaches into at the end of its way, pushed along on that way.

    Many hypotheses move a thing alike, and what it pushes among dozens of others may take seconds to work out.
    """
    met = _given_way(after, {solid.name: solid for solid in free})
    found = {solid.name: solid for solid in free if solid.name in met}
    if not found:
        return {}
    thinnest = min(min(part.size) for solid in (before, *found.values()) for part in solid.parts)
    stride = max(0.5 * thinnest, SAME_OUTCOME)  # m; with longer ones the shortest way out might be that behind it
    steps = max(math.ceil(math.dist(before.position, after.position) / stride), 1)
    for k in range(1, steps + 1):
        there = between(before.pose, after.pose, k / steps)
        found |= _given_way(after.at(there.t, there.q), found)
    return found


def _given_way(solid: Solid, free: Mapping[str, Solid]) -> dict[str, Solid]:
    """Those of the free solids that reach into another one, pushed out of that."""
    pushed_out = separate([solid, *free.values()], dict.fromkeys(free, 1.0), around=(solid.name,))
    return {name: free[name].moved(position) for name, position in pushed_out.items()}
