"""Calibration of a camera from a recording: what it saw there, beside what was believed then."""

from __future__ import annotations

from agents.calibrator.calibrate import calibrate
from agents.calibrator.config import CalibratorConfig
from agents.calibrator.reporting import make_report, refusal
from agents.calibrator.views import Views, only_camera
from agents.replay.source import ReplayedGraph
from dsr.calibration import Report
from dsr.errors import ConfigError
from dsr.memory import Memory

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
        method: one of `dsr.calibration.METHODS`.
        begin: s since the recording's first message, from when on views count: after the camera moved.
        end: s, until when; None for the recording's end.
        force: call the pose adopted whatever speaks against it.

    Raises:
        ConfigError: for a camera that is not there, or has seen nothing of use.
    """
    end = source.duration if end is None else min(end, source.duration)
    memory = source.at(begin)
    views: Views | None = None
    while True:
        views = views or _views(memory, camera, source.index.begin + begin)
        if views is not None:
            views.update()
        if source.ended or source.time >= end:
            break
        source.forward(min(end, source.time + _STEP))
    if views is None:
        views = Views(memory, camera or only_camera(memory), 0.0, CalibratorConfig())  # raises what is wrong
    sightings = views.sightings()
    if not sightings:
        raise ConfigError(refusal(views.skipped, end - begin))
    before = memory.edge(views.parent, views.camera, "RT")["pose"]
    solution = calibrate(sightings, before, method)
    return make_report(views.camera, views.parent, solution, adopted=solution.is_adoptable or force)


def _views(memory: Memory, camera: str, since: float) -> Views | None:
    """None as long as the recording does not tell of the camera."""
    try:
        return Views(memory, camera or only_camera(memory), since, CalibratorConfig())
    except ConfigError:
        return None
