"""Expectations and metrics about cameras: where they are believed to be, and how often they were calibrated."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from agents.scenario.format.events import CameraBump
from agents.scenario.format.expectations import Calibrations, CameraError
from agents.scenario.judge.findings import Finding, mm
from agents.scenario.truth.history import Error, History, Sample

RIGHT = (0.003, math.radians(0.3))
"""m, rad from the truth within which a camera's pose is right"""


def _camera_error(check: CameraError, history: History, sample: Sample) -> Finding:
    error = sample.camera_error
    if error is None:
        return False, "the camera is nowhere"
    right = error.position <= check.tolerance and error.rotation <= check.angle
    return right, f"{mm(error.position)}, {math.degrees(error.rotation):.2f} deg"


def _calibrations(check: Calibrations, history: History, sample: Sample) -> Finding:
    told = [text for time, text in history.calibrations if time <= sample.time]
    right = check.least <= len(told) and (check.most is None or len(told) <= check.most)
    return right, f"{len(told)}" + "".join(f"; {text}" for text in told)


CAMERAS: dict[type, Callable[[Any, History, Sample], Finding]] = {
    CameraError: _camera_error,
    Calibrations: _calibrations,
}
"""How each of these checks is judged."""


def camera_metrics(history: History) -> dict[str, float]:
    """Measure the camera's error in runs in which a camera is bumped or calibrated: at the end, and for how long it was
    wrong.
    """
    bumps = [
        history.spans[number][0]
        for number, event in enumerate(history.scenario.events, start=1)
        if isinstance(event, CameraBump) and number in history.spans
    ]
    errors = [(sample.time, error) for sample in history.samples if (error := sample.camera_error) is not None]
    if not errors or not (bumps or history.calibrations):
        return {}
    last = errors[-1][1]
    found = {
        "camera_error_m": last.position,
        "camera_error_rad": last.rotation,
        "times_calibrated": float(len(history.calibrations)),
    }
    if bumps and _is_right(last):
        wrong = max((time for time, error in errors if time >= bumps[-1] and not _is_right(error)), default=bumps[-1])
        found["camera_recovery_time_s"] = next(time for time, _ in errors if time > wrong) - bumps[-1]
    return found


def _is_right(error: Error) -> bool:
    return error.position <= RIGHT[0] and error.rotation <= RIGHT[1]
