"""Calibrates a camera from a recording: its percepts there, beside the beliefs of that time."""

from __future__ import annotations

import math

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.calibrate import calibrate
from agents.calibrator.solve.reporting import make_report, refusal
from agents.calibrator.watch.views import Views, only_camera
from agents.replay.source import ReplayedGraph
from dsr.errors import ConfigError
from dsr.math3d.tolerance import SAME_POSE
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.calibration import Report

_STEP = 0.05  # s between two looks at the recording


def calibrate_recorded(
    source: ReplayedGraph,
    camera: str,
    method: str,
    *,
    begin: float = 0.0,
    end: float | None = None,
    force: bool = False,
) -> Report:
    """Calibrate on all views of a camera in a recording; nothing is written.

    Args:
        source: the recording.
        camera: its node; empty for the only one.
        method: one of `dsr.vocabulary.calibration.method_names()`.
        begin: s since the recording's first message, from when on views count: after the camera moved.
        end: s, until when; None for the recording's end.
        force: call the pose adopted whatever speaks against it.

    Raises:
        ConfigError: for a camera that is not there, or has seen nothing of use.
    """
    if begin >= source.duration:
        raise ConfigError(f"the recording ends at {source.duration:.1f} s, before {begin:g} s")
    end = source.duration if end is None else min(end, source.duration)
    memory = source.at(begin)
    views: Views | None = None
    before = Pose()
    while True:
        if views is None and (views := _views(memory, camera, source.index.begin + begin)) is not None:
            before = memory.edge(views.parent, views.camera, "RT")["pose"]
        if views is not None:
            _check_mount(memory, views, before, source.time)
            views.update()
        if source.ended or source.time >= end:
            break
        source.forward(min(end, source.time + _STEP))
    if views is None:
        views = Views(memory, camera or only_camera(memory), 0.0, CalibratorConfig())  # raises what is wrong
    sightings = views.sightings()
    if not sightings:
        raise ConfigError(refusal(views.skipped, end - begin))
    solution = calibrate(sightings, before, method)
    adopted, unchanged = solution.is_adoptable or force, solution.confirms and not force
    return make_report(views.camera, views.parent, solution, adopted=adopted, unchanged=unchanged)


def _check_mount(memory: Memory, views: Views, before: Pose, time: float) -> None:
    """Raises `ConfigError` if the camera was given another pose until then."""
    pose = memory.get_pose(views.parent, views.camera, "RT")
    if pose is not None and not SAME_POSE.covers(before, pose):
        raise ConfigError(
            f"{views.camera} was given another pose after {time:.1f} s: what was seen before and after that cannot be "
            f"used together; use --from {math.ceil(10.0 * time) / 10.0:.1f} or --until an earlier time"
        )


def _views(memory: Memory, camera: str, since: float) -> Views | None:
    """None as long as the recording does not tell of the camera."""
    try:
        return Views(memory, camera or only_camera(memory), since, CalibratorConfig())
    except ConfigError:
        return None
