"""How well relations and actions are known, and how far off unseen objects are: metrics by name."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from agents.scenario.format.model import Scenario
from agents.scenario.truth.actions import compare
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.measures import pose_error
from agents.scenario.truth.relations import true_contents, true_relations
from dsr.math3d.tolerance import PoseTolerance
from dsr.vocabulary.observed_actions import KINDS, UNKNOWN

PERIOD = 0.1
"""s between two moments at which relations are compared"""
LASTING = 0.5
"""s that a true relation must last for its delay to be measured"""

_SAME = PoseTolerance(1e-4, 1e-4)  # m, rad within which an object counts as unmoved
_Pairs = frozenset[tuple[str, str]]


def accuracy(history: History, window: Sequence[Sample]) -> dict[str, float]:
    """Measure the accuracy of actions over the whole run, and of relations and unseen objects over `window`."""
    return {**_of_actions(history), **_of_relations(history, window), **_of_unseen(history, window)}


def _of_actions(history: History) -> dict[str, float]:
    comparison = compare(history)
    found = [match for match in comparison.matches if match.inferred is not None]
    told = len(found) + len(comparison.extra)
    metrics = _shares("action", len(found), told, len(comparison.matches))
    for kind in KINDS:
        pairs = [(match.true, match.inferred) for match in found if match.true.kind == kind and match.inferred]
        if pairs:
            noticed = [inferred.noticed - true.time for true, inferred in pairs]
            off = [abs(inferred.action.time - true.time) for true, inferred in pairs]
            metrics[f"{kind.lower()}_delay_median_s"] = float(np.median(noticed))
            metrics[f"{kind.lower()}_delay_max_s"] = max(noticed)
            metrics[f"{kind.lower()}_time_error_max_s"] = max(off)
    known = [match for match in found if match.true.by != UNKNOWN and match.inferred]
    if known:
        right = sum(match.inferred is not None and match.inferred.action.by == match.true.by for match in known)
        metrics["action_by_right"] = right / len(known)
    return metrics


def _of_relations(history: History, window: Sequence[Sample]) -> dict[str, float]:
    """Precision and recall over all moments, and how long after it began a true relation was believed."""
    metrics: dict[str, float] = {}
    moments = thinned(window)
    truths = TrueRelations(history.scenario)
    of_kind: dict[str, Callable[[Sample], tuple[_Pairs, _Pairs]]] = {
        "on": truths.on, "in": truths.inside, "grasping": true_holders,
    }  # fmt: skip
    for kind, true_of in of_kind.items():
        compared = [(sample, *true_of(sample)) for sample in moments]
        claimed = [told(sample, kind) - ignored for sample, _, ignored in compared]
        right = sum(len(pairs & true) for pairs, (_, true, _) in zip(claimed, compared, strict=True))
        metrics |= _shares(kind, right, sum(map(len, claimed)), sum(len(true) for _, true, _ in compared))
        delays = _delays([(sample, true) for sample, true, _ in compared], kind)
        if delays:
            metrics |= {f"{kind}_delay_median_s": float(np.median(delays)), f"{kind}_delay_max_s": max(delays)}
    return metrics


class TrueRelations:
    """The true relations `on` and `in`; computed anew when something has moved."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._last: Sample | None = None
        self._on: _Pairs = frozenset()
        self._in: _Pairs = frozenset()

    def on(self, sample: Sample) -> tuple[_Pairs, _Pairs]:
        """The true pairs of `on`, and the pairs that do not count: of objects that move or are held, and of contents
        and container.
        """
        self._update(sample)
        busy = sample.moving | sample.grasped.keys()
        claimed = told(sample, "on")
        ignored = frozenset(pair for pair in claimed | self._on if pair[0] in busy or pair in self._in)
        return self._on - ignored, ignored

    def inside(self, sample: Sample) -> tuple[_Pairs, _Pairs]:
        """The true pairs of `in`, and the pairs that do not count: none."""
        self._update(sample)
        return self._in, frozenset()

    def _update(self, sample: Sample) -> None:
        last = self._last
        if last is None or not _is_same(last, sample):
            self._last = sample
            self._on = true_relations(self._scenario, sample.truth, sample.gripped)
            self._in = true_contents(self._scenario, sample.truth)


def _is_same(a: Sample, b: Sample) -> bool:
    if a.truth.keys() != b.truth.keys() or a.gripped != b.gripped:
        return False
    return all(_SAME.covers(pose, b.truth[name]) for name, pose in a.truth.items())


def true_holders(sample: Sample) -> tuple[_Pairs, _Pairs]:
    """Who truly holds what; what the experimenter holds without a hand, and mere touch, does not count.

    While a thing is handed over, both hands hold it.
    """
    true = frozenset((by, name) for name, by in sample.grasped.items() if by != UNKNOWN) | sample.pinched.items()
    ignored = frozenset((by, name) for name, by in sample.touched.items()) - true
    return true, ignored


def told(sample: Sample, kind: str) -> _Pairs:
    """The pairs of a kind of edge that the memory tells."""
    return frozenset((src, dst) for type, src, dst in sample.edges if type == kind)


def _delays(compared: Sequence[tuple[Sample, _Pairs]], kind: str) -> list[float]:
    """How long after it began each true relation that lasts was believed, s; what was believed before has no delay."""
    pairs: set[tuple[str, str]] = set().union(*(true for _, true in compared))
    return [
        delay
        for pair in sorted(pairs)
        for stretch in _stretches(compared, pair)
        if stretch[-1].time - stretch[0].time >= LASTING
        if (delay := _delay(stretch, pair, kind)) is not None
    ]


def _stretches(compared: Sequence[tuple[Sample, _Pairs]], pair: tuple[str, str]) -> list[list[Sample]]:
    """The samples of each time in which a relation became true and stayed so; first the last one before."""
    found: list[list[Sample]] = []
    for (before, was_true), (sample, true) in pairwise((one, pair in pairs) for one, pairs in compared):
        if true and not was_true:
            found.append([before])
        if true and found:
            found[-1].append(sample)
    return found


def _delay(stretch: Sequence[Sample], pair: tuple[str, str], kind: str) -> float | None:
    before, *during = stretch
    if pair in told(before, kind):
        return None
    return next((sample.time - during[0].time for sample in during if pair in told(sample, kind)), None)


def unseen_curves(history: History, window: Sequence[Sample]) -> dict[str, list[tuple[float, float]]]:
    """How far off the belief of each object was while it was not perceived: (s, m), means of whole seconds."""
    curves = {}
    for spec in history.scenario.objects:
        seconds: dict[int, list[float]] = defaultdict(list)
        for sample in _unseen(history, window, spec.name):
            if error := pose_error(sample, "belief", spec.name):
                seconds[math.floor(sample.time)].append(error.position)
        if seconds:
            curves[f"unseen_error_{spec.name}_m"] = [(float(s), float(np.mean(of))) for s, of in seconds.items()]
    return curves


def _of_unseen(history: History, window: Sequence[Sample]) -> dict[str, float]:
    """Distance of beliefs from the truth while an object was not perceived, after it once was."""
    metrics: dict[str, float] = {}
    everything: list[float] = []
    for spec in history.scenario.objects:
        unseen = _unseen(history, window, spec.name)
        errors = [error.position for sample in unseen if (error := pose_error(sample, "belief", spec.name))]
        if errors:
            metrics |= _spread(f"unseen_error_{spec.name}", errors)
            metrics[f"unseen_believed_{spec.name}"] = len(errors) / len(unseen)
        everything += errors
    return metrics | (_spread("unseen_error", everything) if everything else {})


def _unseen(history: History, window: Sequence[Sample], name: str) -> list[Sample]:
    """Where an object was not perceived, after it once was."""
    first = next((one.time for one in history.samples if one.perceived.get(name)), math.inf)
    return [one for one in window if one.time > first and not one.perceived.get(name) and name in one.truth]


def _spread(name: str, errors: Iterable[float]) -> dict[str, float]:
    values = np.array(list(errors))
    return {
        f"{name}_median_m": float(np.median(values)),
        f"{name}_p95_m": float(np.quantile(values, 0.95)),
        f"{name}_max_m": float(values.max()),
    }


def _shares(name: str, right: int, told: int, true: int) -> dict[str, float]:
    """Precision and recall; what has no denominator is left out."""
    metrics = {f"{name}_precision": right / told} if told else {}
    return metrics | ({f"{name}_recall": right / true} if true else {})


def thinned(window: Sequence[Sample]) -> list[Sample]:
    """The samples at moments `PERIOD` apart."""
    kept: list[Sample] = []
    for sample in window:
        if not kept or sample.time >= kept[-1].time + PERIOD - 1e-6:
            kept.append(sample)
    return kept
