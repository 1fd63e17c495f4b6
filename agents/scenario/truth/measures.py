"""Numbers about percepts and beliefs: errors, gaps, overlaps, drift."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import msgspec
import numpy as np

from agents.scenario.format.geometry import Ball, PlacedShape, ScenarioBox, gap_below, overlap, pieces
from agents.scenario.format.layout import table_box
from agents.scenario.format.model import ObjectSpec, Scenario, TableSpec
from agents.scenario.format.units import Size
from agents.scenario.truth.history import Error, Sample, Source
from dsr.math3d.transforms import Pose

Piece = ScenarioBox | Ball

_GROUND = 1.0
"""m from the top of the table down, where nothing else can be."""


class Overlap(msgspec.Struct, frozen=True):
    """Two things that reach into each other."""

    depth: float
    """m, depth of the overlap"""
    first: str
    second: str


def pose_error(sample: Sample, source: Source, name: str) -> Error | None:
    """Error of the percept or belief at one moment; None if it or the truth is missing."""
    pose, true = sample.poses(source).get(name), sample.truth.get(name)
    return Error(*pose.distance(true)) if pose and true else None


def mean_error(samples: Iterable[Sample], source: Source, name: str) -> Error | None:
    """Errors averaged over the samples in which the object has a belief and, for percepts, is perceived."""
    used = [
        error
        for sample in samples
        if name in sample.beliefs and (source == "belief" or sample.perceived.get(name))
        if (error := pose_error(sample, source, name))
    ]
    if not used:
        return None
    return Error(_mean(error.position for error in used), _mean(error.rotation for error in used))


def height_error(sample: Sample, name: str) -> float | None:
    """World z of the belief minus the true one, m; None if one is missing."""
    belief, true = sample.beliefs.get(name), sample.truth.get(name)
    return float(belief.translation[2] - true.translation[2]) if belief and true else None


def belief_gap(scenario: Scenario, sample: Sample, name: str) -> float | None:
    """Height of the belief above the table or belief that is under it, m; None without a belief."""
    bodies = {
        spec.name: PlacedShape(spec.shape, spec.size, pose)
        for spec in believed_objects(scenario, sample)
        if (pose := sample.beliefs.get(spec.name))
    }
    own = bodies.pop(name, None)
    return None if own is None else gap_below(own, [*bodies.values(), _ground(scenario.table)])


def drift(samples: Sequence[Sample], name: str) -> float | None:
    """Largest distance (m) of the belief from where it is in the first sample; None if ever missing."""
    poses = [sample.beliefs.get(name) for sample in samples]
    positions = [pose.translation for pose in poses if pose is not None]
    if not positions or len(positions) < len(poses):
        return None
    return float(np.linalg.norm(np.array(positions) - positions[0], axis=1).max())


def believed_objects(scenario: Scenario, sample: Sample) -> list[ObjectSpec]:
    """The scenario's objects, those that were found by depth with the extents that they are believed to have."""
    return [
        spec if (size := sample.sizes.get(spec.name)) is None else _resized(spec, size) for spec in scenario.objects
    ]


def _resized(spec: ObjectSpec, size: Size) -> ObjectSpec:
    shape = tuple(part._replace(size=size) for part in spec.shape)
    return msgspec.structs.replace(spec, size=size, shape=shape)


def pose_boxes(objects: Iterable[ObjectSpec], poses: dict[str, Pose]) -> dict[str, ScenarioBox]:
    """The boxes that objects fill at `poses`."""
    return {
        spec.name: ScenarioBox(pose.translation, pose.rotation_matrix, np.array(spec.size))
        for spec in objects
        if (pose := poses.get(spec.name))
    }


def pose_pieces(objects: Sequence[ObjectSpec], poses: dict[str, Pose]) -> dict[str, list[Piece]]:
    """List the pieces of objects at `poses`, in the world."""
    shapes = {spec.name: spec.shape for spec in objects}
    return {name: pieces(shapes[name], box) for name, box in pose_boxes(objects, poses).items()}


def _ground(table: TableSpec) -> PlacedShape:
    """The table and all below, of which nothing is known."""
    width, length, _ = table.size
    x, y, top = table.position
    return PlacedShape((), (width, length, _GROUND), Pose((x, y, top - 0.5 * _GROUND), (0.0, 0.0, 0.0, 1.0)))


class OverlapMeter:
    """Finds the deepest overlap of percepts or beliefs; pairs that did not move are not computed again."""

    def __init__(self, scenario: Scenario, source: Source) -> None:
        self._scenario = scenario
        self._source: Source = source
        self._table = table_box(scenario.table)
        self._known: dict[tuple[str, str], tuple[tuple[object, ...], float]] = {}

    def deepest(self, samples: Iterable[Sample], wanted: Callable[[str], bool]) -> Overlap | None:
        """The deepest overlap of a wanted object with another one or the table; None if nothing overlaps."""
        found = (overlap for sample in samples for overlap in self._overlaps(sample, wanted))
        return max(found, key=lambda overlap: overlap.depth, default=None)

    def _overlaps(self, sample: Sample, wanted: Callable[[str], bool]) -> Iterable[Overlap]:
        poses, objects = sample.poses(self._source), believed_objects(self._scenario, sample)
        boxes = pose_boxes(objects, poses)
        made_of = pose_pieces(objects, poses) | {"table": [self._table]}
        pairs = [(name, "table") for name in boxes] + _neighbours(boxes)
        for first, second in pairs:
            if wanted(first) or wanted(second):
                where = tuple(
                    (pose.t, pose.q, sample.sizes.get(name)) for name in (first, second) if (pose := poses.get(name))
                )
                known = self._known.get((first, second))
                if known is None or known[0] != where:
                    known = self._known[first, second] = (where, _depth(made_of[first], made_of[second]))
                if known[1] > 0:
                    yield Overlap(known[1], first, second)


def _neighbours(boxes: dict[str, ScenarioBox]) -> list[tuple[str, str]]:
    """Pairs of boxes that are near enough to touch."""
    names = list(boxes)
    centers = np.array([box.center for box in boxes.values()]).reshape(-1, 3)
    reaches = np.linalg.norm([box.size for box in boxes.values()], axis=1) / 2 if names else np.zeros(0)
    distances = np.linalg.norm(centers[:, None] - centers[None, :], axis=2)
    first, second = np.nonzero(np.triu(distances < reaches[:, None] + reaches[None, :], 1))
    return [(names[i], names[j]) for i, j in zip(first.tolist(), second.tolist(), strict=True)]


def _depth(first: Sequence[Piece], second: Sequence[Piece]) -> float:
    """The deepest overlap of their pieces, m; at most 0 if there is none."""
    return max(overlap(a, b) for a in first for b in second)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
