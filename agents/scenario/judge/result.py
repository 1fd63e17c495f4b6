"""The outcome of a run, as it is written to `result.json`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from agents.scenario.judge.overload import Overload
from dsr.files.private_files import write_json


class Verdict(msgspec.Struct, frozen=True):
    """The outcome of one expectation."""

    text: str
    """The expectation, in words."""
    passed: bool
    actual: str
    """The finding, in words."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of one run."""

    scenario: str
    seed: int
    mode: Literal["live", "lockstep"]
    sensor: Literal["pixels", "poses"]
    policy: str | None = None
    """Name of the method that explained surprises, if the run was told one."""
    hands: Literal["model", "colour"] | None = None
    """How hands were found in images, if the run was told so."""
    passed: bool
    """Every expectation holds."""
    expectations: list[Verdict]
    metrics: dict[str, float]
    """SI units, the unit at the end of the name; only what could be measured, always finite."""
    curves: dict[str, list[tuple[float, float]]] = {}
    """Measurements over time: (s, value), in the unit at the end of the name."""
    notes: list[str]
    """Metrics that could not be measured, and why."""
    overload: Overload | None = None
    """How far the machine was too busy; None if it was not, and in lockstep."""

    def __post_init__(self) -> None:
        wrong = [name for name, value in self.metrics.items() if not math.isfinite(value)]
        wrong += [name for name, curve in self.curves.items() if not np.isfinite(curve).all()]
        if wrong:
            raise ValueError(f"metrics that are not finite: {', '.join(wrong)}")


def write_result(result: Result, file: Path) -> None:
    """Write `result` as JSON, making the folder if it is missing."""
    write_json(result, file)
