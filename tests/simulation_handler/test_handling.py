"""What a hand has to do with an object: the table of states and evidence as a whole."""

from __future__ import annotations

import pytest

from dsr.vocabulary.handling import ENDED, HOLDING, Handling
from simulation_handler.hands.relation import (
    DROPPED,
    FREE,
    HIDING,
    LEFT_BEHIND,
    LET_GO,
    PINCHING,
    PUT_DOWN,
    TAKING,
    TOUCHING,
    TRANSITIONS,
    Sign,
    after,
    holds,
    is_told,
)


def test_each_evidence_is_in_the_table_and_each_state_is_reached_from_free() -> None:
    assert TRANSITIONS.keys() == set(Sign)
    reached = {FREE}
    for _ in Handling:
        reached |= {after(state, sign) for state in reached for sign in Sign}
    assert reached == set(Handling)


@pytest.mark.parametrize(
    ("signs", "state"),
    [
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.OPEN_AT_REST), PUT_DOWN),
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.OPEN_UNSEEN), LET_GO),
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.OPEN_UNSEEN, Sign.OPEN_AT_REST), LET_GO),
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.FALLS, Sign.OPEN_AT_REST), DROPPED),
        ((Sign.TOUCHES, Sign.HIDDEN, Sign.SHOWN), TOUCHING),
        ((Sign.TOUCHES, Sign.ALONG, Sign.HIDDEN), HIDING),
        ((Sign.COVERED, Sign.TAKEN), TAKING),
        ((Sign.TAKEN,), FREE),
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.ABSENT), LEFT_BEHIND),
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.THROUGH_WALL, Sign.OPPOSED), LEFT_BEHIND),
        ((Sign.TOUCHES, Sign.OPPOSED, Sign.THROUGH_WALL, Sign.SHOWN, Sign.OPPOSED), PINCHING),
    ],
)
def test_evidence_in_a_row_leads_to_a_state(signs: tuple[Sign, ...], state: Handling) -> None:
    now = FREE
    for sign in signs:
        now = after(now, sign)
    assert now is state


@pytest.mark.parametrize("state", Handling)
def test_what_holds_is_told_and_what_has_ended_is_not(state: Handling) -> None:
    always = holds(state, held=False, hovers=False, seen=False)
    ever = any(holds(state, held=h, hovers=v, seen=s) for h in (0, 1) for v in (0, 1) for s in (0, 1))
    assert always == (state in HOLDING)
    assert not (ever and state in ENDED)
    assert is_told(state, held=True) == (state not in ENDED)
