"""Calibrations of cameras: residuals before and after as bars and a page, and where a camera was thought to be."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import rerun as rr

from agents.viewer import palette
from agents.viewer.model import DrawnCamera, DrawnPlace, place_of
from agents.viewer.scene import ENTITY, pinhole, transform
from agents.viewer.texts import markdown
from dsr import Change, Memory, Pose
from dsr.frames.tree import WORLD
from dsr.timeline import EVENT, read_entry
from dsr.vocabulary.calibration import CALIBRATED, CALIBRATION, STEADY, Report, read_report
from dsr.vocabulary.relations import nodes_by_name

PAGE = "mind/calibrations"
RESIDUALS = "series/residual_mm"
_LINGER = 60.0  # s for which the old frustum stays
_NEWEST = 4  # on the page
_HALF_BAR = 0.2  # of the distance between two objects


class CalibrationView:
    """Logs news of calibrations: poses that were written, as events tell, and other outcomes of requests."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._known: dict[str, Report] = {}  # by the name of the request or event
        self._page = ""
        self._before: dict[str, tuple[Report, float]] = {}
        self._places: dict[str, DrawnPlace] = {}

    def draw(self, changes: Iterable[Change], memory: Memory, cameras: list[DrawnCamera], now: float) -> None:
        """Log what is not at time `now` (s) as it was before."""
        for node in nodes_by_name(memory, CALIBRATION):
            report = read_report(memory, node.name)
            if report is not None and (report.unchanged or not report.adopted):
                self._note(node.name, report)
        for time, name, report in _written(changes, memory):
            self._note(name, report)
            self._before[report.camera] = (report, time + _LINGER)
        page = calibrations_page(memory, list(self._known.values()))
        if page != self._page:
            self._page = page
            self._recording.log(PAGE, rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN))
        for camera in cameras:
            self._draw_before(memory, camera, now)

    def _note(self, name: str, report: Report) -> None:
        """Keep a report of a request or event for the page, and draw its bars, if it is news."""
        if self._known.get(name) != report:
            self._known.pop(name, None)
            self._known[name] = report
            self._log_residuals(report)

    def _log_residuals(self, report: Report) -> None:
        """Bars of each object beside each other, at the number that it has on the page."""
        numbers = np.arange(1.0, len(report.objects) + 1.0)
        for name, values, shift, color in (
            ("before", [one.before_m for one in report.objects], -_HALF_BAR, palette.GREY),
            ("after", [one.after_m for one in report.objects], _HALF_BAR, palette.CAMERA),
        ):
            heights, widths = [1e3 * value for value in values], [2.0 * _HALF_BAR] * len(values)
            bars = rr.BarChart(heights, color=color, abscissa=numbers + shift, widths=widths)
            self._recording.log(f"{RESIDUALS}/{report.camera}/{name}", bars)

    def _draw_before(self, memory: Memory, camera: DrawnCamera, now: float) -> None:
        """The frustum where the camera was thought to be, in grey, as its parent moves."""
        entity = f"{ENTITY}/cameras/{camera.name}_before"
        report, until = self._before.get(camera.name, (None, -math.inf))
        place = None if report is None else _place(memory, report)
        if report is None or now > until or place is None or camera.intrinsics is None:
            if self._places.pop(camera.name, None) is not None:
                self._recording.log(entity, rr.Clear(recursive=True))
            self._before.pop(camera.name, None)
        elif self._places.get(camera.name) != place:
            if camera.name not in self._places:
                self._recording.log(f"{entity}/image", pinhole(camera.intrinsics, palette.GREY))
            self._places[camera.name] = place
            self._recording.log(entity, transform(place))


def _written(changes: Iterable[Change], memory: Memory) -> list[tuple[float, str, Report]]:
    """When (s) poses were written, the names of the events that tell so, and their reports, oldest first."""
    names = {change.name for change in changes if change.element == "node" and change.type == EVENT}
    entries = [read_entry(node) for name in names if (node := memory.get_node(name)) is not None]
    return sorted(
        (entry.begin, entry.name, report)
        for entry in entries
        if entry is not None and entry.kind == CALIBRATED
        if (report := read_report(memory, entry.name)) is not None
    )


def calibrations_page(memory: Memory, reports: list[Report]) -> str:
    """Markdown: cameras that are in doubt, and the newest of the `reports` (oldest first) with their residuals."""
    cameras = nodes_by_name(memory, "camera")
    parts = [
        f"**{markdown(node.name)}: {markdown(node['mount'])}** {markdown(node.get('explanation', ''))}"
        for node in cameras
        if node.get("mount", STEADY) != STEADY
    ]
    parts += [_told(report) for report in reports[::-1][:_NEWEST]] or ["*Nothing was calibrated.*"]
    return "\n\n".join(parts)


def _told(report: Report) -> str:
    rows = [
        f"| {number} | {markdown(one.name)}{' (does not agree)' if one.is_outlier else ''} | "
        f"{1e3 * one.before_m:.1f} mm, {math.degrees(one.before_rad):.2f}° | "
        f"{1e3 * one.after_m:.1f} mm, {math.degrees(one.after_rad):.2f}° |"
        for number, one in enumerate(report.objects, 1)
    ]
    return "\n".join([markdown(report.text), "", "| | object | before | after |", "|---|---|---|---|", *rows])


def _place(memory: Memory, report: Report) -> DrawnPlace | None:
    """Where the camera would be had it not been calibrated."""
    world_from_parent = memory.get_transform(WORLD, report.parent)
    before = Pose(report.before[:3], report.before[3:])
    return None if world_from_parent is None else place_of(world_from_parent @ before)
