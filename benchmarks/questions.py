"""Whether answers of `dsr ask` are right: 120 questions over 27 scenarios in lockstep, against the truth.

    python -m benchmarks.questions
    python -m benchmarks.questions c_pour --json answers.json

Each question is asked at its moment of a run (seed 0, sensor `poses`), what-if questions by the simulation handler of
the run. An answer is right, wrong, or the question is not understood.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from agents.scenario.truth.history import History
from benchmarks.question_list import FRESH, LATER, NAIVE, QUESTIONS, Asked, Truth
from dsr.imagining import Thinking
from dsr.memory import Memory
from dsr.narration import Moment
from dsr.narration.answer import Response
from dsr.narration.answers import answer
from dsr.vocabulary.what_if import WhatIf

RIGHT, WRONG, UNKNOWN = "right", "wrong", "not understood"


class Asking(NamedTuple):
    """A question while it is answered."""

    asked: Asked
    moment: float
    """s after the start"""
    thinking: Thinking[Response]


class Asker:
    """Asks each question of a scenario once its time has come, and lets the answers come as the run goes on.

    Args:
        questions: of one scenario.
    """

    def __init__(self, questions: Sequence[Asked]) -> None:
        self.asking: list[Asking] = []
        self.history: History | None = None
        self.start = 0.0
        """s, time 0 of the run on the memory's clock"""
        self._left = sorted(questions, key=lambda asked: asked.time)

    def __call__(self, elapsed: float, memory: Memory, history: History) -> None:
        """Look at a step of the run, `elapsed` s after its start."""
        self.history, now = history, memory.clock.now()
        self.start = now - elapsed
        while self._left and self._left[0].time <= elapsed:
            asked = self._left.pop(0)
            thought = answer(Moment(memory, now, self.start), asked.question)
            what_if = WhatIf(memory.transport, memory.keys, memory.clock)
            self.asking.append(Asking(asked, elapsed, Thinking(thought, what_if)))
        for one in self.asking:
            one.thinking.poll()


class Outcome(NamedTuple):
    """A question with its answer and what that is worth."""

    asked: Asked
    response: Response
    worth: str


def outcomes(scenario: str, questions: Sequence[Asked]) -> list[Outcome]:
    """Play a scenario and judge the answers to its questions."""
    asker = Asker(questions)
    run_lockstep(make_run(scenario, seed=0, sensor="poses"), onlooker=asker)
    found = []
    for one in asker.asking:
        response = one.thinking.result or Response(question=one.asked.question, text=one.thinking.failed or "no answer")
        worth = UNKNOWN
        if response.understood and asker.history is not None:
            truth = Truth(asker.history, one.moment, asker.start)
            worth = RIGHT if one.asked.is_right(response, truth) else WRONG
        found.append(Outcome(one.asked, response, worth))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask the questions of the scenarios that are named, or all; returns 1 if an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", help="names; all 27 by default")
    parser.add_argument("--json", type=Path, help="write questions and answers to this file")
    options = parser.parse_args(arguments)
    questions = (*QUESTIONS, *NAIVE, *FRESH, *LATER)
    wanted = options.scenarios or list(dict.fromkeys(asked.scenario for asked in questions))
    found: list[Outcome] = []
    for scenario in wanted:
        for one in outcomes(scenario, [asked for asked in questions if asked.scenario == scenario]):
            found.append(one)
            print(f"{one.worth:15} {scenario} {one.asked.time:g} s: {one.asked.question}")
            print(f"{'':15} {one.response.text}", flush=True)
    lists = (
        ("questions", QUESTIONS), ("of those who do not know the grammar", NAIVE),
        ("over other scenarios", FRESH), ("asked later", LATER),
    )  # fmt: skip
    for name, some in lists:
        counts = Counter(one.worth for one in found if one.asked in some)
        told = f"{counts[RIGHT]} right, {counts[WRONG]} wrong, {counts[UNKNOWN]} not understood"
        print(f"{counts.total()} {name}: {told}")
    counts = Counter(one.worth for one in found)
    if options.json:
        rows = [
            {"scenario": one.asked.scenario, "time": one.asked.time, "question": one.asked.question,
             "answer": one.response.text, "worth": one.worth}
            for one in found
        ]  # fmt: skip
        options.json.write_text(json.dumps(rows, indent=2), encoding="utf-8")
    return 1 if counts[WRONG] else 0


if __name__ == "__main__":
    sys.exit(main())
