"""Whether what is told of a memory is true in the judge's truth: claims of statements beside samples of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from agents.scenario.format.model import Scenario
from agents.scenario.truth.actions import EARLY, LATE, true_actions
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.relations import true_contents, true_relations
from dsr.narration import Basis, StatedClaim, Statement
from dsr.vocabulary.observed_actions import KINDS

LAG = 1.0
"""s in which a claim about now must have been true: until then nobody who looks can have noticed (`MOST_SILENT`)"""
NEAR = 0.02
"""m within which a claimed place is right: a centimetre of rounding along each axis, and the noise of a percept"""
_UNJUDGED = ("appeared", "disappeared", "sees")
"""Relations of claims that are about the memory or a person, of which no sample tells."""
_HANDS = ("touching", "began touching", "ended touching")
_AROUND = 1.5
"""s around the time of an event in which its relation must begin or end to be true: `LAG`, and the samples beside it"""


class Judged(NamedTuple):
    """A claim and whether it is true."""

    time: float
    """s after the start, when it was told"""
    statement: Statement
    claim: StatedClaim
    is_true: bool
    was_at_once: bool
    """Whether it was true at the very moment at which it was told, too."""


class Verdict(NamedTuple):
    """The statements of one run."""

    told: int
    """Statements, the same ones at several times counted each time."""
    own: int
    """Those about the robot's mind, of which no truth tells."""
    believed: int
    """Those that say that they are believed."""
    judged: list[Judged]
    """Claims of the others."""
    beliefs: list[Judged]
    """Claims of those that are marked as belief: these may be false."""

    @property
    def false(self) -> list[Judged]:
        """The claims that are not marked as belief, and false."""
        return [one for one in self.judged if not one.is_true]


class TruthJudge:
    """Judges claims by a whole run.

    Args:
        history: of the run, complete.
        start: s, time 0 of the run on the memory's clock.
    """

    def __init__(self, history: History, start: float) -> None:
        self._scenario: Scenario = history.scenario
        self._samples: Sequence[Sample] = history.samples
        self._times = np.array([sample.time for sample in history.samples])
        self._start = start
        self._facts: dict[int, frozenset[tuple[str, tuple[str, ...]]]] = {}
        self._actions = true_actions(history)
        self._objects = {spec.name for spec in history.scenario.objects}

    def verdict(self, told: Iterable[tuple[float, Statement]]) -> Verdict:
        """Judge statements, each with when it was told (s after the start)."""
        listed = list(told)
        judged: list[Judged] = []
        beliefs: list[Judged] = []
        for time, statement in listed:
            for claim in statement.claims:
                if not self._is_judged(claim):
                    continue
                when = time if statement.time is None else statement.time - self._start
                is_event = statement.time is not None
                long = 0.0 if statement.since is None or statement.time is None else statement.time - statement.since
                is_true = self._holds(claim, when, is_event, long)
                one = Judged(time, statement, claim, is_true, self._holds_at(claim, when))
                (beliefs if statement.basis is Basis.BELIEVED else judged).append(one)
        count = [statement.basis for _, statement in listed]
        return Verdict(len(listed), count.count(Basis.OWN), count.count(Basis.BELIEVED), judged, beliefs)

    def is_true(self, claim: StatedClaim, time: float) -> bool:
        """Whether a claim about now was true within `LAG` before `time` (s after the start)."""
        return self._holds(claim, time, is_event=False)

    def _is_judged(self, claim: StatedClaim) -> bool:
        return claim.relation not in _UNJUDGED

    def _holds(self, claim: StatedClaim, time: float, is_event: bool, unseen: float = 0.0) -> bool:
        """Whether a claim was true at a time (s); of an action, also within the `unseen` time (s) before."""
        if claim.relation in KINDS:
            return any(
                action.kind == claim.relation and action.thing == claim.participants[0]
                and -EARLY <= time - action.time <= LATE + unseen
                for action in self._actions
            )  # fmt: skip
        if is_event:
            return self._turned(claim, time)
        return any(self._is_so(claim, number) for number in self._between(time - LAG, time))

    def _holds_at(self, claim: StatedClaim, time: float) -> bool:
        return any(self._is_so(claim, number) for number in self._between(time - LAG, time)[-1:])

    def _turned(self, claim: StatedClaim, time: float) -> bool:
        """Whether a relation began or ended about then; what was so at the start began before."""
        change, _, relation = claim.relation.partition(" ")
        bare = StatedClaim(relation, claim.participants)
        held = [self._is_so(bare, number) for number in self._between(time - _AROUND, time + _AROUND)]
        wanted = change == "began"
        starts = wanted and time <= _AROUND and held[:1] == [True]
        return starts or (wanted in held and (not wanted) in held)

    def _between(self, begin: float, end: float) -> range:
        """Numbers of the samples between two times (s); the one before if there is none."""
        first, last = np.searchsorted(self._times, [begin, end + 1e-6])
        return range(int(first), int(last)) if last > first else range(max(0, int(last) - 1), int(last))

    def _is_so(self, claim: StatedClaim, number: int) -> bool:
        sample = self._samples[number]
        relation, names = claim.relation, claim.participants
        if relation == "at":
            there = sample.truth.get(names[0])
            if there is None or claim.place is None:
                return False
            return bool(np.linalg.norm(np.subtract(there.t, claim.place)) <= NEAR)
        if relation == "gone":
            return names[0] not in sample.truth
        if relation == "empty":
            return names[0] not in sample.grasped.values() and (names[0] != "gripper" or sample.held is None)
        if relation in ("grasping", "touching"):
            holder = sample.grasped.get(names[1]) or ("gripper" if sample.held == names[1] else None)
            return holder == names[0] or (relation == "touching" and sample.touched.get(names[1]) == names[0])
        return (relation, names) in self._facts_of(number)

    def _facts_of(self, number: int) -> frozenset[tuple[str, tuple[str, ...]]]:
        """The true relations `on` and `in` of a sample."""
        if number not in self._facts:
            sample = self._samples[number]
            resting = true_relations(self._scenario, sample.truth, sample.gripped)
            contents = true_contents(self._scenario, sample.truth)
            self._facts[number] = frozenset([*(("on", pair) for pair in resting), *(("in", pair) for pair in contents)])
        return self._facts[number]
