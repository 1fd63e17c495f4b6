"""A calibration for people and programs: the report, and its line of text."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from agents.calibrator.solve.solution import CalibrationSolution
from dsr.graph.schema import is_within_bounds
from dsr.timeline import Chronicle
from dsr.vocabulary.calibration import CALIBRATED, ObjectReport, Report


def make_report(
    camera: str, parent: str, solution: CalibrationSolution, *, adopted: bool, unchanged: bool = False
) -> Report:
    """Make the report of a calibration of the camera in the frame `parent`; `unchanged`: nothing was to be written.

    A covariance that no pose of the graph may have tells as little as none.
    """
    known = solution.pose.covariance
    covariance = () if known is None else tuple(known.ravel().tolist())
    metres, radians = solution.shift
    condition = solution.geometry.condition
    return Report(
        camera=camera,
        parent=parent,
        method=solution.method,
        adopted=adopted,
        unchanged=unchanged,
        text=_text(camera, solution, adopted=adopted, unchanged=unchanged),
        before=(*solution.before.t, *solution.before.q),
        after=(*solution.pose.t, *solution.pose.q),
        covariance=covariance if is_within_bounds(covariance) else (),
        shift_m=metres,
        shift_rad=radians,
        condition=condition if math.isfinite(condition) else -1.0,
        weak=solution.geometry.is_weak,
        views=solution.views,
        sightings=solution.sightings,
        agreeing=solution.agreeing,
        objects=tuple(
            ObjectReport(one.name, *one.before, *one.after, is_outlier=one.is_outlier) for one in solution.residuals
        ),
    )


def encoded(report: Report) -> str:
    """Encode a report for the attribute `report` of a request, or of the event that tells of a new pose."""
    return msgspec.json.encode(report).decode()


def tell(chronicle: Chronicle, report: Report) -> None:
    """Put the event of a new pose onto the timeline."""
    objects = (one.name for one in report.objects)
    chronicle.happened(CALIBRATED, (report.camera, *objects), text=report.text, report=encoded(report))


def refusal(skipped: Mapping[str, int], waited: float) -> str:
    """Why nothing could be computed after `waited` s, given what was left out, by reason."""
    reasons = ", ".join(f"{count} {reason}" for reason, count in sorted(skipped.items()))
    left_out = f" (percepts left out: {reasons})" if reasons else ""
    return f"the camera has seen nothing of use for {waited:.0f} s{left_out}"


def _text(camera: str, solution: CalibrationSolution, *, adopted: bool, unchanged: bool) -> str:
    metres, radians = solution.shift
    before, after = (_average(solution, which) for which in ("before", "after"))
    if unchanged:
        within = f"{1e3 * metres:.1f} mm, {math.degrees(radians):.2f} deg"
        return f"{camera} is where it was believed to be: {within} from there is within the error of this calibration"
    off = f"; not explained: {', '.join(solution.outliers)}" if adopted and solution.outliers else ""
    found = (
        f"{1e3 * metres:.1f} mm, {math.degrees(radians):.2f} deg from where it was believed; "
        f"residual {1e3 * before:.1f} -> {1e3 * after:.1f} mm over {_counted(solution)} in "
        f"{solution.views} view(s){off}"
    )
    if not adopted:
        return f"{camera} stays: {solution.problem}. It would be {found}"
    forced = f" (forced: {solution.problem})" if solution.problem else ""
    return f"{camera} is {found}{forced}"


def _counted(solution: CalibrationSolution) -> str:
    """How many objects the residuals are of."""
    every = len(solution.residuals)
    trusted = sum(not one.is_outlier for one in solution.residuals)
    return f"{every} object(s)" if trusted in (0, every) else f"{trusted} of {every} objects"


def _average(solution: CalibrationSolution, which: str) -> float:
    """m, mean over the objects that are no outliers, or all if there are only such."""
    trusted = [one for one in solution.residuals if not one.is_outlier] or solution.residuals
    return float(np.mean([getattr(one, which)[0] for one in trusted]))
