"""The sizes of a human hand, read from `etc/hands/adult.toml`: what it hides and holds follows from them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec

from dsr.config.toml import TomlFile
from dsr.files.built_in import ETC
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part

ADULT = ETC / "hands" / "adult.toml"
"""The hand that all persons are taken to have."""
Length = Annotated[float, msgspec.Meta(gt=0)]


class HandBox(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A box in the palm's frame, along its axes."""

    size: tuple[Length, Length, Length]
    """Edge lengths, m"""
    centre: Vector3
    """m"""

    @property
    def part(self) -> Part:
        """The box as a piece of a shape."""
        return Part("box", self.size, self.centre)


class Finger(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A finger of a right hand, in the palm's frame: x towards the fingers, z out of the back."""

    knuckle: Vector3
    """m, where it begins"""
    tip: Vector3
    """m, where it ends while the hand is at rest"""


class Anatomy(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A right hand and its forearm; a left one is the mirror image."""

    palm: HandBox
    forearm: tuple[HandBox, ...]
    """From the wrist on"""
    fingers: Annotated[tuple[Finger, ...], msgspec.Meta(min_length=1)]
    """From the thumb on"""
    finger_thickness: Length
    """m"""
    tip_radius: Length
    """m, of a fingertip"""

    @property
    def reach(self) -> float:
        """How far (m) the longest finger goes beyond the palm's origin while the hand is at rest."""
        return max(finger.tip[0] for finger in self.fingers)


def anatomy_of(file: Path = ADULT) -> Anatomy:
    """The hand of a file. Raises `ConfigError` with its line for a field that does not fit."""
    return TomlFile(file).convert(Anatomy)


HAND = anatomy_of()
"""Every human hand"""
