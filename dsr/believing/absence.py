"""How much it tells that cameras do not recognise what they should see: learned parameters that all agents share."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from dsr.config.toml import TomlFile
from dsr.files.built_in import ETC

LEARNED = ETC / "belief" / "worlds.toml"
"""The file with all learned parameters of the belief. Written by `python -m benchmarks.learning`."""


class Absence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How soon cameras recognise what they should see."""

    rate: Annotated[float, msgspec.Meta(ge=0)]
    """1/s, of percepts of an object of which a share of 1 is to be seen"""
    power: Annotated[float, msgspec.Meta(ge=0)]
    """1, exponent of the share in the rate"""
    blind: Annotated[float, msgspec.Meta(ge=0, le=1)]
    """1, probability that it is not recognised however long, at a place where all of it is to be seen"""


@cache
def learned_absence(file: Path = LEARNED) -> Absence:
    """The parameters of a file. Raises `ConfigError` with its line for a field that does not fit."""
    return TomlFile(file).convert(Absence, ("parameters", "absence"))
