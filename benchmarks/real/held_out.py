"""How well a mount that was fitted to some views predicts the others: by pixels, and by mm at the target."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rich.table import Table

from agents.calibrator.hand_eye.model import Parameters, ViewModel
from agents.calibrator.hand_eye.observations import Observations
from dsr.math3d.transforms import Array, exp
from dsr.vocabulary.intrinsics import Intrinsics


class Mount(NamedTuple):
    """What a method found."""

    camera: Array
    """(4, 4) carrier_from_camera"""
    target: Array
    """(4, 4) holder_from_target"""
    intrinsics: Intrinsics
    scale: float = 0.0
    """Logarithm of the target's true over its told size"""
    offsets: Array | None = None
    """(k,) to be added to each joint; None for none"""

    @staticmethod
    def of(found: Parameters) -> Mount:
        """Of a fit."""
        offsets = found.offsets if len(found.offsets) else None
        return Mount(found.mount, found.target, found.intrinsics, found.scale, offsets)


def errors(mount: Mount, views: Observations) -> Array:
    """(v, 2) root mean square distance of each view's points from where they are predicted: px, and mm at the target.

    Nothing is fitted to these views, but the order of points that look alike. The mm are distances from viewing rays.
    """
    found = []
    for row in range(len(views)):
        now, view = _at(mount, views, row)
        found.append(min(_of_order(now, view, order) for order in range(len(views.symmetries))))
    return np.array(found)


def predicted(mount: Mount, views: Observations) -> Array:
    """(v, n, 2) px, where each view's points are predicted, in the order in which they fit best."""
    found = []
    for row in range(len(views)):
        now, view = _at(mount, views, row)
        errors_by_order = [_of_order(now, view, order) for order in range(len(views.symmetries))]
        best = view.reordered([int(np.argmin([px for px, _ in errors_by_order]))])
        found.append(mount.intrinsics.project(ViewModel(best).points(now)[0]))
    return np.array(found)


def _at(mount: Mount, views: Observations, row: int) -> tuple[Parameters, Observations]:
    """One view, and what the mount says of it."""
    slip = np.eye(4)
    if mount.offsets is not None and views.joint_effects is not None:
        slip = exp(views.joint_effects[row] @ mount.offsets).matrix
    now = Parameters(mount.camera, mount.target, mount.scale, mount.intrinsics, slip[None], np.zeros(0))
    return now, views.subset([row])


def _of_order(now: Parameters, view: Observations, order: int) -> tuple[float, float]:
    model = ViewModel(view.reordered([order]))
    squares, depths = (model.residuals(now)[0] ** 2).sum(axis=1), model.points(now)[0, :, 2]
    seen, focal = model.seen[0], 0.5 * (now.intrinsics.fx + now.intrinsics.fy)
    if not np.isfinite(squares).all():
        return np.inf, np.inf
    mm = 1e3 * np.sqrt((squares * (depths / focal) ** 2)[seen].mean())
    return float(np.sqrt(squares[seen].mean())), float(mm)


def table_of(found: dict[str, list[Array]]) -> tuple[Table, dict[str, dict[str, float]]]:
    """A table of medians and means, and more figures, of errors (v, 2) by method and split.

    `splits` are the medians (mm) of the best and the worst split.
    """
    table = Table()
    table.add_column("method", no_wrap=True)
    for heading in ("px", "mean", "mm", "mean", "splits"):
        table.add_column(heading, justify="right", no_wrap=True)
    figures = {}
    for method, parts in found.items():
        px, mm = np.concatenate(parts).T
        medians = [float(np.median(part[:, 1])) for part in parts]
        numbers = {
            "px_median": float(np.median(px)),
            "px_mean": float(px.mean()),
            "px_worst": float(px.max()),
            "mm_median": float(np.median(mm)),
            "mm_mean": float(mm.mean()),
            "mm_worst": float(mm.max()),
            "mm_median_best_split": min(medians),
            "mm_median_worst_split": max(medians),
        }
        figures[method] = numbers
        shown = [f"{numbers[name]:.2f}" for name in ("px_median", "px_mean", "mm_median", "mm_mean")]
        table.add_row(method, *shown, f"{min(medians):.1f}-{max(medians):.1f}")
    return table, figures
