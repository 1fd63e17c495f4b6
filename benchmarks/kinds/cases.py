"""Finds in a played episode each moment at which a kind of failure may show, and what was believed then."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from agents.scenario.format.model import ObjectSpec
from agents.scenario.judge.accuracy import thinned
from agents.scenario.truth.actions import EARLY, LATE, compare
from agents.scenario.truth.history import History, Sample
from benchmarks.honesty.statement import Statement, mass_near
from benchmarks.honesty.watching import ToldWorlds
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import PLACE, RELEASE
from simulation_handler.shapes.geometry import Solid

LYING, LEANING, ROLLED, DRAGGED = "lying", "leaning", "rolled", "dragged"
EMERGING, FALL, LET_GO = "emerging", "fall", "let go"
KINDS: dict[str, tuple[str, str]] = {
    LYING: ("lying", "a can that lies is believed standing"),
    LEANING: ("leaning", "what leans is believed with a face down"),
    ROLLED: ("rolling_away", "a ball that rolled out of sight is believed elsewhere"),
    DRAGGED: ("letting_go", "what an empty hand in view let go unseen is believed with it"),
    EMERGING: ("emerging", "what comes out of hiding while it moves is believed elsewhere"),
    FALL: ("letting_go", "a fall is told as a placement"),
    LET_GO: ("letting_go", "what was let go of out of sight is believed elsewhere"),
}
"""The scene in which each kind shows, and its failure in words."""
ASLANT = math.cos(math.pi / 3)
"""1, cosine of an axis with the vertical, up to which a can lies: it rests at 90 degrees, and stands at 0"""
FLAT = 0.1
"""rad from having a face down, up to which a thing counts as flat: what leans does so by 0.15 rad and more"""
OFF, OFF_MOVING = 0.1, 0.05
"""m from the truth, from which a place is wrong: unseen, a hand's breadth; in view and moving, 0.15 s at 0.35 m/s"""
RESTED, UNSEEN, NOTICED, WAITED = 1.0, 0.5, 0.3, 1.0
"""s that a can or what leans rests in view, a thing is out of sight, and is back in view, and since it was let go"""
SPEED = 0.05
"""m/s from which a thing moves: half of the slowest slide"""

Palms = Mapping[float, Mapping[str, Vector3]]
"""m, world, of the hands that are perceived, by the time of a sample and the hand's node."""


class Case(NamedTuple):
    """A moment at which a kind of failure may show of one thing."""

    kind: str
    seed: int
    object: str
    time: float
    """s after the start"""
    wrong: bool
    """Whether what is believed most is the failure."""
    told: float
    """1, probability with which that is told, if it is wrong"""


class Found(NamedTuple):
    """A moment that counts, before anything is compared."""

    kind: str
    object: str
    sample: Sample


def moments(history: History) -> list[Found]:
    """All moments of all kinds but `FALL`, by the truth alone, ten times a second."""
    window = thinned(history.window(history.scenario.settle, history.end))
    finders: list[Callable[[ObjectSpec, Sequence[Sample]], Iterator[Found]]] = [
        _lying, _leaning, _rolled, _emerging, _let_go,
    ]  # fmt: skip
    return [found for spec in history.scenario.objects for find in finders for found in find(spec, window)]


def cases(seed: int, history: History, told: Mapping[float, ToldWorlds], palms: Palms) -> list[Case]:
    """All moments of all kinds, with what was believed."""
    specs = history.scenario.objects
    found = [
        _compared(seed, one, told[one.sample.time], palms.get(one.sample.time, {}), specs) for one in moments(history)
    ]
    return [*(case for case in found if case is not None), *_falls(seed, history)]


def shows(scene: str, history: History) -> bool:
    """Whether at least one kind of that scene may show in the true course of an episode."""
    there = {one.kind for one in moments(history)} | {case.kind for case in _falls(0, history)}
    return any(KINDS[kind][0] == scene for kind in there)


def _lying(spec: ObjectSpec, window: Sequence[Sample]) -> Iterator[Found]:
    if [part.kind for part in spec.shape] != ["cylinder"]:
        return
    since = math.inf
    for sample in window:
        pose = sample.truth.get(spec.name)
        rests = spec.name in sample.in_view and spec.name not in sample.moving
        if pose is None or not rests or _upright(pose) >= ASLANT:
            since = math.inf
            continue
        since = min(since, sample.time)
        if sample.time - since >= RESTED:
            yield Found(LYING, spec.name, sample)


def _leaning(spec: ObjectSpec, window: Sequence[Sample]) -> Iterator[Found]:
    since = math.inf
    for sample in window:
        pose = sample.truth.get(spec.name)
        rests = spec.name in sample.in_view and spec.name not in sample.moving and spec.name not in sample.grasped
        if pose is None or not rests or _tilt(spec, pose) <= FLAT:
            since = math.inf
            continue
        since = min(since, sample.time)
        if sample.time - since >= RESTED:
            yield Found(LEANING, spec.name, sample)


def _rolled(spec: ObjectSpec, window: Sequence[Sample]) -> Iterator[Found]:
    last: Sample | None = None
    for sample in window:
        pose = sample.truth.get(spec.name)
        if spec.name in sample.in_view:
            last = sample
        elif spec.type == "ball" and last is not None and pose is not None and spec.name in last.moving:
            was = last.truth[spec.name]
            if pose.distance(was)[0] > OFF and sample.time - last.time >= UNSEEN and spec.name not in last.grasped:
                yield Found(ROLLED, spec.name, sample)


def _emerging(spec: ObjectSpec, window: Sequence[Sample]) -> Iterator[Found]:
    hidden, seen, before = math.inf, math.inf, None
    was_hidden = False
    for sample in window:
        pose = sample.truth.get(spec.name)
        speed = 0.0 if pose is None or before is None else _speed(before, sample, spec.name)
        before = sample if pose is not None else None
        if spec.name not in sample.in_view:
            hidden, seen = min(hidden, sample.time), math.inf
            was_hidden = sample.time - hidden >= UNSEEN
            continue
        hidden, seen = math.inf, min(seen, sample.time)
        was_hidden = was_hidden and speed > SPEED
        if was_hidden and sample.time - seen >= NOTICED:
            yield Found(EMERGING, spec.name, sample)


def _let_go(spec: ObjectSpec, window: Sequence[Sample]) -> Iterator[Found]:
    since, holder = math.inf, ""
    for sample in window:
        if spec.name not in sample.truth or spec.name in sample.in_view:
            since, holder = math.inf, sample.grasped.get(spec.name, "")
        elif spec.name in sample.grasped:
            since, holder = math.inf, sample.grasped[spec.name]
        elif holder:
            since = min(since, sample.time)
            if sample.time - since >= WAITED and spec.name not in sample.moving:
                yield Found(LET_GO, spec.name, sample)
                yield Found(DRAGGED, spec.name, sample)


def _compared(
    seed: int, found: Found, told: ToldWorlds, palms: Mapping[str, Vector3], specs: Sequence[ObjectSpec]
) -> Case | None:
    """The case of a moment; None where no empty hand is in view away from the thing, as `DRAGGED` asks."""
    name, truth = found.object, found.sample.truth[found.object]
    said = told.places.get(name, Statement())
    if found.kind == LYING:
        share = sum(likely.weight for likely in said.poses if _upright(likely.pose) >= ASLANT)
        return Case(LYING, seed, name, found.sample.time, share > 0.5, share)
    if found.kind == LEANING:
        spec = next(one for one in specs if one.name == name)
        share = sum(likely.weight * _flatness(spec, likely.pose) for likely in said.poses)
        return Case(LEANING, seed, name, found.sample.time, share > 0.5, share)
    if found.kind == DRAGGED:
        away = [palm for palm in palms.values() if math.dist(palm, truth.t) > 2 * OFF]
        if not away:
            return None
        share = sum(likely.weight for likely in said.poses if _goes_with(likely.pose, truth, away))
        return Case(DRAGGED, seed, name, found.sample.time, share > 0.5, share)
    limit = OFF_MOVING if found.kind == EMERGING else OFF
    best = max(said.poses, key=lambda likely: likely.weight, default=None)
    if best is None or said.gone > 0.5:
        return Case(found.kind, seed, name, found.sample.time, True, said.gone)
    wrong = best.pose.distance(truth)[0] > limit
    return Case(
        found.kind, seed, name, found.sample.time, wrong, mass_near(said, best.pose.t, limit) if wrong else 0.0
    )


def _falls(seed: int, history: History) -> Iterator[Case]:
    comparison = compare(history)
    for match in comparison.matches:
        true = match.true
        if true.kind != RELEASE:
            continue
        placed = [
            one.confidence
            for one in comparison.extra
            if (one.action.kind, one.action.thing) == (PLACE, true.thing)
            and -EARLY <= one.action.time - true.time <= LATE
        ]
        yield Case(FALL, seed, true.thing, true.time, bool(placed), max(placed, default=0.0))


def _goes_with(pose: Pose, truth: Pose, palms: Sequence[Vector3]) -> bool:
    """Whether a believed place is wrong, and nearer to a palm than to the true place."""
    off = pose.distance(truth)[0]
    return off > OFF and any(math.dist(pose.t, palm) < off for palm in palms)


def _upright(pose: Pose) -> float:
    """Cosine (0 to 1) of a thing's z axis with the vertical, whichever end is up."""
    return abs(float(pose.rotation_matrix[2, 2]))


def _tilt(spec: ObjectSpec, pose: Pose) -> float:
    """Rad by which a thing is turned from having a face down."""
    return Solid(spec.name, spec.size, pose.t, pose.q, shape=spec.shape).face_down()[1]


def _flatness(spec: ObjectSpec, said: Pose) -> float:
    """The probability that a thing has a face down, if it is where and how a pose with a covariance has it.

    Its tilt about a face is Rayleigh distributed then. A pose that leans is no face down, however unsure.
    """
    if said.cov is None or _tilt(spec, said) > FLAT:
        return 0.0
    _, turning = said.parent_covariances()
    return 1.0 - math.exp(-(FLAT**2) / float(turning[0, 0] + turning[1, 1]))


def _speed(before: Sample, sample: Sample, name: str) -> float:
    return before.truth[name].distance(sample.truth[name])[0] / (sample.time - before.time)
