"""What is seen of each human hand, and the ways that its palm and its fingertips were seen to take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from dsr.transforms import Pose
from simulation_handler.paths import Path

UNSEEN = 0.25
"""s after its last percept, from which an object is where its hand has it, or pushes it."""
_MEASURED = 0.15  # s up to which a fingertip is known


class HandPercept(NamedTuple):
    """What is seen of a hand."""

    pose: Pose
    """world_from_hand, with stamp"""
    tips: Mapping[str, Pose]
    """Fingertips in the world by name, with stamps; their rotations say nothing."""
    perceived: bool
    """Whether the hand is in sight now."""


@dataclass
class Hand:
    """A hand and the ways it took."""

    perceived: bool = False
    path: Path = field(default_factory=Path)
    tips: dict[str, Path] = field(default_factory=dict)

    def measures(self, tip: Path) -> bool:
        """Whether one of its fingertips is known as lately as its palm."""
        return tip.newest >= self.path.newest - _MEASURED

    @property
    def measured(self) -> int:
        """How many of its fingertips are."""
        return sum(self.measures(tip) for tip in self.tips.values())
