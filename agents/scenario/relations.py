"""What rests on what in the true world, from where everything is."""

from __future__ import annotations

from agents.scenario.geometry import Box, footprint_overlap, penetration
from agents.scenario.layout import table_box
from agents.scenario.measures import pose_boxes
from agents.scenario.model import Scenario
from dsr.transforms import Pose

GROUND = ("table",)
"""What else things rest on, as a node of the working memory; the floor has none."""
REACH = 0.003
"""m, the largest gap between two things of which one rests on the other"""

_LEAST_OVERLAP = 0.001  # m, of the outlines seen from above: things side by side do not carry each other


def true_relations(scenario: Scenario, truth: dict[str, Pose], held: str | None = None) -> frozenset[tuple[str, str]]:
    """Pairs (upper, lower) of which the upper rests on the lower: an object or `table`; nothing that is `held`.

    One rests on the other if lowering it by `REACH` makes it reach into the other's top.
    """
    boxes = pose_boxes(scenario, truth)
    table = table_box(scenario.table)
    found = set()
    for name, box in boxes.items():
        if name == held:
            continue
        lowered = Box(box.center - (0.0, 0.0, REACH), box.rotation, box.size)
        below = {other: lower for other, lower in boxes.items() if other not in (name, held)} | {"table": table}
        found |= {(name, other) for other, lower in below.items() if _rests(box, lowered, lower)}
    return frozenset(found)


def _rests(box: Box, lowered: Box, lower: Box) -> bool:
    if lower.center[2] >= box.center[2] or lowered.bottom >= lower.top or box.bottom < lower.center[2]:
        return False
    return footprint_overlap(box, lower) > _LEAST_OVERLAP and penetration(lowered, lower) > 0.0
