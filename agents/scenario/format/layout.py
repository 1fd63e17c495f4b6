"""Where the objects of a scenario start, with the variation of a seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from agents.scenario.format.geometry import ScenarioBox, overlap, pieces, upright_box
from agents.scenario.format.model import ObjectSpec, Scenario, TableSpec
from dsr.errors import ConfigError
from dsr.math3d import polygons
from dsr.math3d.boxes import Boxes, gaps

TOUCH = 0.0005
"""m, how deep boxes may overlap and still count as touching only"""
_ATTEMPTS = 200


def start_poses(scenario: Scenario, rng: np.random.Generator) -> list[ObjectSpec]:
    """The objects in the file's order, moved and turned by `[random]`.

    Objects that stand on one another are moved together and turned one by one. A draw in which objects
    overlap is thrown away. Raises `ConfigError` if no draw fits.
    """
    varied = scenario.random.position > 0 or scenario.random.yaw > 0
    for _ in range(_ATTEMPTS if varied else 1):
        drawn = _draw(scenario, rng) if varied else list(scenario.objects)
        if overlapping(drawn) is None:
            return drawn
    raise ConfigError(
        f"scenario {scenario.name!r}: {len(scenario.objects)} objects overlap in each of {_ATTEMPTS} draws; "
        "expected a smaller [random] position or yaw, or more space between the objects"
    )


def object_box(spec: ObjectSpec) -> ScenarioBox:
    """The box that an object fills at its start."""
    pose = spec.pose
    return ScenarioBox(pose.translation, pose.rotation_matrix, np.array(spec.size))


def table_box(table: TableSpec) -> ScenarioBox:
    """The box that the table top fills."""
    x, y, z = table.position
    return upright_box((x, y, z - table.size[2] / 2), 0.0, table.size)


def overlapping(objects: list[ObjectSpec]) -> tuple[int, int, float] | None:
    """Indexes of the first two objects that overlap, and how deep (m); None if all are apart."""
    boxes = [object_box(spec) for spec in objects]
    made_of = [pieces(spec.shape, box) for spec, box in zip(objects, boxes, strict=True)]
    for first, second in _close_pairs(boxes):
        depth = max(overlap(a, b) for a in made_of[first] for b in made_of[second])
        if depth > TOUCH:
            return first, second, depth
    return None


def _close_pairs(boxes: Sequence[ScenarioBox]) -> Iterator[tuple[int, int]]:
    """Indexes of the boxes that overlap, in order of the second and then of the first."""
    centers, axes, sizes = (np.array([getattr(b, part) for b in boxes]) for part in ("center", "rotation", "size"))
    for second in range(1, len(boxes)):
        before = Boxes(centers[:second], axes[:second], 0.5 * sizes[:second])
        itself = Boxes(*(np.repeat(part[second : second + 1], second, axis=0) for part in (centers, axes, 0.5 * sizes)))
        for first in np.flatnonzero(gaps(before, itself) < -TOUCH).tolist():
            yield first, second


def _draw(scenario: Scenario, rng: np.random.Generator) -> list[ObjectSpec]:
    """One draw: an offset per tower, an angle per object."""
    towers = _tower_of_each(scenario.objects)
    reach = scenario.random.position
    offsets = {tower: rng.uniform(-reach, reach, 2) for tower in sorted(set(towers))}
    turns = rng.uniform(-1, 1, len(towers)) * scenario.random.yaw
    return [
        _moved(spec, offsets[tower], float(turn))
        for spec, tower, turn in zip(scenario.objects, towers, turns, strict=True)
    ]


def _moved(spec: ObjectSpec, offset: np.ndarray, turn: float) -> ObjectSpec:
    x, y, z = spec.position
    position = (x + float(offset[0]), y + float(offset[1]), z)
    return msgspec.structs.replace(spec, position=position, yaw=spec.yaw + turn)


def _tower_of_each(objects: list[ObjectSpec]) -> list[int]:
    """Index of the lowest object of the tower that each object belongs to; what encloses an object is below it."""
    boxes = [object_box(spec) for spec in objects]
    towers = list(range(len(objects)))
    for index in sorted(towers, key=lambda i: (round(boxes[i].bottom, 3), -float(np.prod(boxes[i].size)))):
        for lower in range(len(objects)):
            if lower != index and (_stands_on(boxes[index], boxes[lower]) or _is_in(boxes[index], boxes[lower])):
                towers[index] = towers[lower]
    return towers


def _stands_on(upper: ScenarioBox, lower: ScenarioBox) -> bool:
    touches = abs(upper.bottom - lower.top) < 2 * TOUCH
    return touches and polygons.overlap(upper.footprint, lower.footprint)[0] > TOUCH


def _is_in(box: ScenarioBox, other: ScenarioBox) -> bool:
    """Whether the middle of a box is inside a larger one."""
    inside = np.abs(other.rotation.T @ (box.center - other.center)) <= 0.5 * other.size
    return bool(inside.all()) and float(np.prod(box.size)) < float(np.prod(other.size))
