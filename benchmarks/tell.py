"""Whether each sentence that `dsr tell` makes is true: every built-in scenario in lockstep, against the judge's truth.

    python -m benchmarks.tell
    python -m benchmarks.tell cubes_swapped c_pour --json told.json

An account of the memory is made each second of a run (seed 0, sensor `poses`). Statements that are not marked as belief
must be true: what is told of now, in the truth within the second before; what happened, around its time. A place is
right within 2 cm. Of the statements that are marked as belief, the number that are false is shown for information.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.scenario.format.scenario import scenario_files
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from agents.scenario.truth.history import History
from benchmarks.telling import Judged, TruthJudge, Verdict
from dsr.errors import DsrError
from dsr.memory import Memory
from dsr.narration import Moment, Statement, account

PERIOD = 1.0
"""s between two accounts: as long as a claim about now may have been true before"""


class AccountTaker:
    """Makes an account of the memory of a run each `PERIOD`, with what happened since the one before."""

    def __init__(self) -> None:
        self.told: list[tuple[float, Statement]] = []
        """When (s after the start) and what."""
        self.history: History | None = None
        self.start = 0.0
        """s, time 0 of the run on the memory's clock"""
        self._next = PERIOD

    def __call__(self, elapsed: float, memory: Memory, history: History) -> None:
        """Look at a step of the run, `elapsed` s after its start."""
        moment = Moment.of(memory)
        self.history, self.start = history, moment.now - elapsed
        if elapsed >= self._next:
            self._next += PERIOD
            self.told += [(elapsed, statement) for statement in account(moment, since=moment.now - PERIOD)]


def told_in(name: str) -> Verdict:
    """Play a scenario and judge what is told of it. Raises `DsrError` if it cannot be played."""
    taker = AccountTaker()
    run_lockstep(make_run(name, seed=0, sensor="poses"), onlooker=taker)
    if taker.history is None:
        raise ValueError(f"{name}: the run had no step")
    return TruthJudge(taker.history, taker.start).verdict(taker.told)


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge the scenarios that are named, or all; returns 1 if a statement is false and no belief, or none was made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", help="names; all built-in ones by default")
    parser.add_argument("--json", type=Path, help="write the figures and the false statements to this file")
    options = parser.parse_args(arguments)
    print(f"{'scenario':32} {'told':>6} {'own':>6} {'belief':>6} {'judged':>6} {'false':>6} {'wrong beliefs':>14}")
    rows: dict[str, Any] = {}
    for name in options.scenarios or sorted(scenario_files()):
        try:
            verdict = told_in(name)
        except DsrError as error:
            print(f"{name:32} not played: {error}")
            continue
        rows[name] = _row(verdict)
        wrong = sum(not one.is_true for one in verdict.beliefs)
        counts = (verdict.told, verdict.own, verdict.believed, len(verdict.judged), len(verdict.false))
        print(f"{name:32} {' '.join(f'{count:6}' for count in counts)} {wrong:6} of {len(verdict.beliefs)}", flush=True)
        for one in verdict.false:
            print(f"    {_line(one)}")
    total = {key: sum(row[key] for row in rows.values()) for key in ("told", "judged", "false_count")}
    told, judged, false = total.values()
    print(f"{len(rows)} scenarios: {told} statements, {judged} claims judged, {false} false")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2), encoding="utf-8")
    return 1 if total["false_count"] or not rows else 0


def _row(verdict: Verdict) -> dict[str, Any]:
    return {
        "told": verdict.told, "own": verdict.own, "believed": verdict.believed, "judged": len(verdict.judged),
        "at_once": sum(one.was_at_once for one in verdict.judged), "false_count": len(verdict.false),
        "false": [_line(one) for one in verdict.false], "beliefs": len(verdict.beliefs),
        "wrong_beliefs": [_line(one) for one in verdict.beliefs if not one.is_true],
    }  # fmt: skip


def _line(one: Judged) -> str:
    return f"{one.time:.1f} s: {one.statement.text} ({one.claim.relation} {', '.join(one.claim.participants)})"


if __name__ == "__main__":
    sys.exit(main())
