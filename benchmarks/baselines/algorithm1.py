"""Algorithm 1 of the CORTEX paper (section 4.4.2), as published: one surprising object after the other.

for each surprising object c:
    if something is beneath c by the relations:  put that under c again
    elif c is beneath something:                 delete that relation; put c where it is seen
    else:                                        put c where it is seen
"""

from __future__ import annotations

from dataclasses import replace

from dsr.vocabulary.explained import MOVED, PLACED_UNDER, RELATION_ENDED, ExplainedChange
from simulation_handler.explaining.drafting import draft
from simulation_handler.explaining.hypotheses import Hypothesis, Move
from simulation_handler.explaining.policy import Explanation
from simulation_handler.explaining.situation import Situation


class Algorithm1:
    """The published method: no simulation of alternatives, no scores, no visibility."""

    name = "algorithm1"

    def prepare(self) -> None:
        """Nothing is to be prepared."""

    def explain(self, situation: Situation) -> Explanation | None:
        """What Algorithm 1 makes of the surprising objects that are seen; of the others it says nothing."""
        hypothesis, changes, ended = Hypothesis(), list[ExplainedChange](), []
        about = [name for name in situation.surprising if name in situation.seen]
        for name in about:
            below = [other for other in situation.beneath.get(name, ()) if other in situation.believed]
            above = sorted(upper for upper, lower in situation.beneath.items() if name in lower)
            if below:
                hypothesis = hypothesis.with_move(Move(name, beneath=(below[0],)))
                changes.append(ExplainedChange(PLACED_UNDER, ((below[0],), (name,))))
                continue
            hypothesis = hypothesis.with_move(Move(name))
            ended += [(upper, name) for upper in above]
            broken = [ExplainedChange(RELATION_ENDED, ((upper, name),)) for upper in above]
            changes += broken or [ExplainedChange(MOVED, ((name,),))]
        if not about:
            return None
        drafted = draft(replace(situation, confirmed={}), hypothesis)  # "under it": not where it was last seen
        return Explanation(
            changes=tuple(changes),
            about=tuple(about),
            solids={name: drafted.solids[name] for name in drafted.placements},
            placements={name: drafted.placements[name] for name in about},
            ended=tuple(ended),
            hypothesis=hypothesis,
        )

    def close(self) -> None:
        """Nothing to release."""
