"""Checks the motions of events: not zero, not too fast, and only balls roll."""

from __future__ import annotations

import math

from agents.scenario.format.events import (
    ArmError,
    CameraBump,
    CameraCover,
    Event,
    FalsePercept,
    HandMove,
    Push,
    Roll,
    SetInMotion,
    Slide,
    Tilt,
)
from agents.scenario.format.inconsistency import require
from agents.scenario.format.model import ObjectSpec, Scenario
from dsr.config.toml_lines import Path

FASTEST = 5.0
"""m/s, what an impulse may change an object's velocity by: as much as a velocity may be"""


def check_motion(event: SetInMotion, path: Path, scenario: Scenario) -> None:
    """The object gets a velocity that is not zero; what rolls is a ball; a hand pushes sideways."""
    spec, name = scenario.object(event.object), event.__struct_config__.tag
    if isinstance(event, Push):
        once = (event.velocity is None) != (event.impulse is None)
        require(once, path, "push: expected either `velocity` (m/s) or `impulse` (N s)")
        _check_impulse(event, spec, path)
    if isinstance(event, Roll):
        message = f"{spec.name!r} is no ball and cannot roll; expected an object whose only part is a sphere, or `push`"
        require(is_ball(spec), (*path, "object"), message)
    require(any(event.along), path, f"{name}: expected a motion that is not zero")
    sideways = event.hand is None or any(event.along[:2])
    require(sideways, (*path, "hand"), f"{name}: a hand pushes sideways; expected a motion along x or y")


def check_change(event: Event, path: Path) -> None:
    """Check that an event's change is not zero."""
    some: dict[str, tuple[float, ...]] = {}
    if isinstance(event, FalsePercept | CameraBump):
        some["an error" if isinstance(event, FalsePercept) else "a motion"] = (*event.translation, *event.rotation)
    if isinstance(event, ArmError):
        some["an error"] = event.translation
    if isinstance(event, ArmError | CameraCover):
        some["a `duration`"] = (event.duration,)
    if isinstance(event, Tilt):
        some["an `angle`"] = (event.angle,)
    if isinstance(event, Slide) and event.by is not None and event.yaw is None:
        some["a motion"] = (*event.by, event.turn)
    if isinstance(event, HandMove) and event.by is not None:
        some["a motion"] = (*event.by, event.turn)
    for what, values in some.items():
        require(any(values), path, f"{event.__struct_config__.tag}: expected {what} that is not zero")


def is_ball(spec: ObjectSpec) -> bool:
    """Whether the object is a sphere and nothing else."""
    return len(spec.shape) == 1 and spec.shape[0].kind == "sphere"


def _check_impulse(event: Push, spec: ObjectSpec, path: Path) -> None:
    if event.impulse is not None:
        change, most = math.hypot(*event.impulse) / spec.mass, FASTEST * spec.mass
        message = f"would change the velocity of {spec.name!r} by {change:.1f} m/s; expected at most {most:g} N s"
        require(change <= FASTEST, (*path, "impulse"), message)
