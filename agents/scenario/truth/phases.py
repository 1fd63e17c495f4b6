"""When each object truly moved, by whom, how far it fell and where it came to rest: read off the samples of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import msgspec

from agents.scenario.format.layout import table_box
from agents.scenario.format.model import Scenario
from agents.scenario.truth.actions import FALLEN
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.relations import true_contents, true_relations
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose

STEP = PoseTolerance(0.0005, 0.005)
"""m, rad from one sample (1/20 s) to the next, up to which an object counts as still: 10 mm/s, 0.1 rad/s"""
PAUSE = 0.25
"""s, the longest rest within one phase: what is taken, tilts or bounces stands still for moments"""


class Phase(msgspec.Struct, frozen=True, kw_only=True):
    """One object on its way, or held, from one rest to the next."""

    object: str
    begin: float
    """s after the start"""
    end: float | None
    """s after the start, when it lay still and nobody held it; None if it never did"""
    moved: float = 0.0
    """m, greatest distance of the object from its place at the beginning"""
    turned: float = 0.0
    """rad from the beginning to the end"""
    held_by: tuple[str, ...] = ()
    """`gripper`, the nodes of hands, `unknown` for the experimenter; in order"""
    fell: float = 0.0
    """m that it came down with nothing under it and nobody holding it, all together"""
    fell_at: float | None = None
    """Time (s after the start) when the object first fell"""
    comes: bool = False
    """Whether the object comes into the scene in this phase."""
    gone: bool = False
    """Whether the object was taken out of the scene."""
    position: tuple[float, float, float] | None = None
    """m, centre, world, at the end; None if it is gone"""
    rests_on: tuple[str, ...] = ()
    """Objects, `table` or `floor`, at the end."""
    inside: tuple[str, ...] = ()
    """Containers and cups that its centre is in, at the end."""


def phases(history: History) -> list[Phase]:
    """List all phases of all objects until the end of the run, in order of their beginnings."""
    names = [spec.name for spec in history.scenario.objects]
    found = [phase for name in names for phase in _phases_of(name, history)]
    return sorted(found, key=lambda phase: (phase.begin, names.index(phase.object)))


def supports(scenario: Scenario, sample: Sample, name: str) -> tuple[str, ...]:
    """Names of the true supports of an object at that moment: other objects, `table` or `floor`; none in the air."""
    found = tuple(sorted(lower for upper, lower in true_relations(scenario, sample.truth) if upper == name))
    below_table = sample.truth[name].t[2] < table_box(scenario.table).bottom
    lies = below_table and name not in sample.moving and name not in sample.grasped
    return found or (("floor",) if lies else ())


def containers(scenario: Scenario, sample: Sample, name: str) -> tuple[str, ...]:
    """The containers and cups that an object's centre is in then."""
    return tuple(sorted(around for inner, around in true_contents(scenario, sample.truth) if inner == name))


def _phases_of(name: str, history: History) -> Iterator[Phase]:
    samples = history.window(0.0, history.end)
    begin: int | None = None
    busy = -1
    for index, (before, sample) in enumerate(pairwise(samples), start=1):
        if _is_busy(name, before, sample):
            begin, busy = (index - 1 if begin is None else begin), index
        elif begin is not None and (sample.time - samples[busy].time > PAUSE or name not in sample.truth):
            yield _phase(name, history, samples[begin : busy + 2], over=True)
            begin = None
    if begin is not None:
        yield _phase(name, history, samples[begin:], over=busy < len(samples) - 1)


def _is_busy(name: str, before: Sample, sample: Sample) -> bool:
    """Whether it moves, is held, comes or goes."""
    start, end = before.truth.get(name), sample.truth.get(name)
    if start is None or end is None:
        return start is not end
    return name in sample.moving or name in sample.grasped or not STEP.covers(start, end)


def _phase(name: str, history: History, samples: Sequence[Sample], *, over: bool) -> Phase:
    scenario, last = history.scenario, samples[-1]
    pose = last.truth.get(name)
    holders = dict.fromkeys(sample.grasped[name] for sample in samples if name in sample.grasped)
    falls = list(_falls(name, scenario, samples))
    fell = sum(height for _, height in falls)
    start = samples[0].truth.get(name)
    there = [sample.truth[name] for sample in samples if name in sample.truth]
    return Phase(
        object=name,
        begin=samples[0].time,
        end=last.time if over else None,
        moved=max(start.distance(pose)[0] for pose in there) if start else 0.0,
        turned=start.distance(pose)[1] if start and pose else 0.0,
        comes=start is None,
        held_by=tuple(holders),
        fell=fell,
        fell_at=falls[0][0] if falls else None,
        gone=pose is None,
        position=None if pose is None else pose.t,
        rests_on=() if pose is None else supports(scenario, last, name),
        inside=() if pose is None else containers(scenario, last, name),
    )


def _falls(name: str, scenario: Scenario, samples: Sequence[Sample]) -> Iterator[tuple[float, float]]:
    """When (s after the start) and how far (m) it came down freely, each time by more than `FALLEN`."""
    begin, height = 0.0, 0.0
    for before, sample in pairwise(samples):
        start, end = before.truth.get(name), sample.truth.get(name)
        if start and end and _drops_freely(name, scenario, before, start, end):
            begin = begin if height else before.time
            height += start.t[2] - end.t[2]
            continue
        if height > FALLEN:
            yield begin, height
        height = 0.0
    if height > FALLEN:
        yield begin, height


def _drops_freely(name: str, scenario: Scenario, before: Sample, start: Pose, end: Pose) -> bool:
    return start.t[2] - end.t[2] > STEP.metres and name not in before.grasped and not supports(scenario, before, name)
