"""What is told of a run is true: some scenarios here, all of them by `python -m benchmarks.tell`."""

from __future__ import annotations

import msgspec
import pytest

from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from benchmarks.tell import AccountTaker, main
from benchmarks.telling import TruthJudge
from dsr.narration import Basis, StatedClaim, Statement, Subject


@pytest.mark.parametrize("name", ["cubes_swapped", "c_pour"])
def test_what_is_not_marked_as_belief_is_true(name: str) -> None:
    taker = AccountTaker()
    run_lockstep(make_run(name, seed=0, sensor="poses"), onlooker=taker)
    assert taker.history is not None
    judge = TruthJudge(taker.history, taker.start)
    verdict = judge.verdict(taker.told)
    assert verdict.false == [] and len(verdict.judged) > 80
    assert verdict.told > verdict.believed + verdict.own > 0
    doubled = [(time, _turned(statement)) for time, statement in taker.told if statement.basis is Basis.PERCEIVED]
    assert len(judge.verdict(doubled).false) == len(judge.verdict(doubled).judged) > 20


def _turned(statement: Statement) -> Statement:
    """The same sentence with false claims about places."""
    claims = [
        StatedClaim("at", claim.participants, (claim.place[0] + 0.05, *claim.place[1:]))
        for claim in statement.claims if claim.place is not None
    ]  # fmt: skip
    return msgspec.structs.replace(statement, claims=tuple(claims), subject=Subject.PLACE)


def test_a_scenario_that_cannot_be_played_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["no_such_scenario"]) == 1
    assert "not played: " in capsys.readouterr().out
