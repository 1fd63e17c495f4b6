"""How deep true objects are in one another, from where they are: what lies far apart is not computed."""

from __future__ import annotations

import math

import numpy as np

from agents.scenario.geometry import Box, overlap, pieces
from agents.scenario.layout import table_box
from agents.scenario.measures import Piece
from agents.scenario.model import Scenario
from dsr.math3d import quaternions
from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Pose

TABLE = "table"
_TURNS = 4  # squares within a circle, turned against each other, whose union is 0.98 of it and never more


def deepest(name: str, pose: Pose, others: dict[str, Pose], scenario: Scenario) -> tuple[str, float]:
    """What an object at `pose` is deepest in, another one or the table, and how deep (m); ("", 0.0) for nothing.

    Args:
        name: of the object.
        pose: world_from_object.
        others: likewise, of those that it may be in.
        scenario: says what they are made of.
    """
    body = _body(name, pose, scenario)
    found = {
        other: _body(other, there, scenario)
        for other, there in others.items()
        if _are_near(name, other, pose, there, scenario)
    }
    found[TABLE] = [table_box(scenario.table)]
    depths = {other: max(overlap(a, b) for a in body for b in parts) for other, parts in found.items()}
    worst = max(depths, key=depths.__getitem__)
    return (worst, depths[worst]) if depths[worst] > 0 else ("", 0.0)


def _are_near(name: str, other: str, pose: Pose, there: Pose, scenario: Scenario) -> bool:
    reach = (math.hypot(*scenario.object(name).size) + math.hypot(*scenario.object(other).size)) / 2
    return math.dist(pose.t, there.t) < reach


def _body(name: str, pose: Pose, scenario: Scenario) -> list[Piece]:
    spec = scenario.object(name)
    return pieces(_without_cylinders(spec.shape), Box(pose.translation, pose.rotation_matrix, np.array(spec.size)))


def _without_cylinders(shape: Shape) -> Shape:
    """The shape with boxes within each cylinder instead of it."""
    return tuple(piece for part in shape for piece in (_within(part) if part.kind == "cylinder" else (part,)))


def _within(cylinder: Part) -> Shape:
    side = cylinder.size[0] / math.sqrt(2.0)
    turns = (quaternions.from_rotvec((0.0, 0.0, math.pi / 2 * k / _TURNS)) for k in range(_TURNS))
    rotations = (quaternions.product(cylinder.rotation, turn) for turn in turns)
    return tuple(Part("box", (side, side, cylinder.size[2]), cylinder.position, turn) for turn in rotations)
