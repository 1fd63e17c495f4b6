"""The same scenario with blocks that nobody tagged or told of: only depth and colour show them."""

from __future__ import annotations

import msgspec

from agents.colors import PALETTE
from agents.scenario.format.inconsistency import InconsistencyError
from agents.scenario.format.model import ObjectSpec, Scenario

SUFFIX = "-untagged"
"""Of the variant's name."""


def untagged(scenario: Scenario) -> Scenario:
    """The scenario without the tags of its boxes and cylinders, and without a word about them to the working memory.

    Each keeps the colour that the plant draws it in. Things of other shapes stay as they are.

    Raises:
        InconsistencyError: if it has no tagged box or cylinder.
    """
    objects = [_stripped(spec, number) for number, spec in enumerate(scenario.objects)]
    if objects == scenario.objects:
        raise InconsistencyError(("object",), "no object is a box or cylinder with a tag; there is no untagged variant")
    return msgspec.structs.replace(
        scenario, name=scenario.name + SUFFIX, title=f"{scenario.title}; without tags", objects=objects
    )


def _stripped(spec: ObjectSpec, number: int) -> ObjectSpec:
    color = spec.color or PALETTE[number % len(PALETTE)]
    block = msgspec.structs.replace(spec, marker_id=None, known=False, color=color)
    return block if spec.marker_id is not None and block.by_depth else spec
