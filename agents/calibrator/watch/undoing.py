"""Undoes the last calibration of a camera."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from agents.calibrator.watch.views import parent_of
from dsr.errors import ConfigError
from dsr.math3d.tolerance import SAME_POSE
from dsr.memory import Memory
from dsr.timeline import Chronicle
from dsr.vocabulary.calibration import CALIBRATED, ObjectReport, Report, pose_of, read_report


def taken_back(memory: Memory, chronicle: Chronicle, camera: str) -> Report:
    """The report of the last change of a camera's pose, from after to before. Taken back twice, it is as it was.

    Raises:
        ConfigError: if the timeline tells of none, or the camera was given another pose since.
    """
    parent = parent_of(memory, camera)
    events = chronicle.query(type="event", kind=CALIBRATED, participants=camera)
    found = [read_report(memory, event.name) for event in reversed(events)]
    reports = [one for one in found if one is not None and one.camera == camera]
    report = next(iter(reports), None)
    if report is None:
        raise ConfigError(f"the timeline tells of no calibration of {camera}")
    pose = memory.get_pose(parent, camera, "RT")
    if pose is None or report.parent != parent or not SAME_POSE.covers(pose, pose_of(report.after)):
        raise ConfigError(f"{camera} was given another pose since its last calibration")
    text = f"{camera} is believed where it was before its last calibration"
    return turned_round(report, text, reports)


def turned_round(report: Report, text: str, known: Iterable[Report] = ()) -> Report:
    """A report from after to before; the covariance of that is told by the report of `known` that led there, if any."""
    there = pose_of(report.before)
    led = (one for one in known if one.parent == report.parent and SAME_POSE.covers(pose_of(one.after), there))
    covariance = next((one.covariance for one in led if one.covariance), ())
    objects = tuple(
        ObjectReport(one.name, one.after_m, one.after_rad, one.before_m, one.before_rad, is_outlier=one.is_outlier)
        for one in report.objects
    )
    back = {"before": report.after, "after": report.before, "covariance": covariance, "objects": objects}
    return msgspec.structs.replace(report, **back, unchanged=False, text=text)
