"""What is told of a hand-eye calibration: the mount with its uncertainty, and each view's residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agents.calibrator.hand_eye.fit import Fitted
from agents.calibrator.hand_eye.model import FIXED, ViewModel, lens_numbers
from agents.calibrator.hand_eye.start import target_poses
from dsr.errors import ConfigError
from dsr.math3d import transforms
from dsr.math3d.batches import logs
from dsr.math3d.transforms import Array, Pose

DISAGREES = 91.0
"""Squared Mahalanobis distance of a view to be dropped: the 99 % quantile of Student's t with 4 degrees of freedom in 6
dimensions, by which the fit weighs"""
_BAD_POINTS = 4.0
"""Residual of a view's points around their own best pose, over the median of all views, from which they are bad"""
_MOST_M, _MOST_DEG = 0.005, 0.5
"""m, degrees: standard deviation of a mount from which it is called weak"""


class ViewReport(msgspec.Struct, frozen=True):
    """One view."""

    image: str
    px: float
    """Root mean square of the points' distances from where mount and robot put them"""
    own_px: float
    """The same from the best pose of this view alone: how well the points were found"""
    mm: float
    """`px` at the distance of the target"""
    distance: float
    """Squared Mahalanobis distance of the view from what the others predict; 6 is usual"""
    weight: float
    """How much the view counts, from 0 to 1"""
    drop: str
    """Why it should be dropped; empty if it should not"""


class HandEyeReport(msgspec.Struct, frozen=True):
    """The outcome."""

    target: str
    is_in_hand: bool
    mount: tuple[float, ...]
    """parent_from_camera, x y z (m) and quaternion x y z w; the parent is the hand, or the base"""
    covariance: tuple[float, ...]
    """(6, 6) of `mount`, row by row, m and rad: a perturbation in the frame of the camera"""
    std_mm: tuple[float, float, float]
    """mm, standard deviations of the camera's place along its own axes"""
    std_deg: tuple[float, float, float]
    """Degrees, of its rotation about its own axes"""
    target_pose: tuple[float, ...]
    """The target in the base, or in the hand if the hand holds it; as `mount`"""
    target_scale: float
    """True over told size of the target, as the robot's moves measure it"""
    target_scale_std: float
    intrinsics: dict[str, float | int | str | tuple[float, ...]]
    """Attributes of a camera's node"""
    intrinsics_std: tuple[float, ...]
    """Of fx, fy, cx, cy (px) and the coefficients; empty if they were not fitted"""
    joint_offsets: dict[str, float]
    """rad or m to add to what the robot tells of each joint; empty if they were not fitted.

    Not of the first and the last joint, whose errors only turn the base and the hand."""
    pixel_std: float
    """px, that the points of a view scatter by themselves"""
    smooth_std: float
    """px, that points beside each other have in common"""
    hand_std: dict[str, float]
    """m or rad, of the hand's poses or joints"""
    views: tuple[ViewReport, ...]
    not_found: tuple[str, ...]
    """Images without the target"""
    advice: str
    """Which view to add; empty if that helps little"""
    problem: str
    """Why the mount should not be relied on; empty if it can be"""


def make_report(
    target: str, model: ViewModel, fitted: Fitted, *, not_found: Sequence[str], joint_names: Sequence[str], advice: str
) -> HandEyeReport:
    """The report of a fit. Raises `ConfigError` if a view shows no pose of the target with the intrinsics found."""
    now = fitted.parameters
    stds = np.sqrt(np.diag(fitted.covariance))
    lens = len(lens_numbers(now.intrinsics)) if model.fits_lens else 0
    views = _views(model, fitted)
    names = list(joint_names) or [f"joint {index}" for index in range(1, len(now.offsets) + 1)]
    x, y, z = (float(1e3 * value) for value in stds[:3])
    roll, pitch, yaw = (math.degrees(value) for value in stds[3:6])
    return HandEyeReport(
        target=target,
        is_in_hand=model.observations.is_in_hand,
        mount=_numbers(now.mount),
        covariance=tuple(fitted.covariance[:6, :6].ravel().tolist()),
        std_mm=(x, y, z),
        std_deg=(roll, pitch, yaw),
        target_pose=_numbers(now.target),
        target_scale=math.exp(now.scale),
        target_scale_std=float(stds[FIXED - 1]),
        intrinsics=now.intrinsics.attributes(),
        intrinsics_std=tuple(stds[FIXED : FIXED + lens].tolist()),
        joint_offsets=dict(list(zip(names, now.offsets.tolist(), strict=False))[1:-1]),
        pixel_std=fitted.noise.pixel,
        smooth_std=fitted.noise.smooth,
        hand_std={one.name: std for one, std in zip(model.observations.noises, fitted.noise.hand, strict=True)},
        views=views,
        not_found=tuple(not_found),
        advice=advice,
        problem=_problem(views, stds),
    )


def _views(model: ViewModel, fitted: Fitted) -> tuple[ViewReport, ...]:
    now, observations, seen = fitted.parameters, model.observations, model.seen
    counts = seen.sum(axis=1)
    # where the robot tells that the hand is, joint offsets included: without the errors of single views
    told = np.tile(np.eye(4), (len(seen), 1, 1))
    if model.fits_offsets and observations.joint_effects is not None:
        told = np.array([transforms.exp(effect @ now.offsets).matrix for effect in observations.joint_effects])
    predicted = now._replace(slips=told)
    squares = (model.residuals(predicted) ** 2).sum(axis=2)
    depths = model.points(predicted)[..., 2]
    focal = 0.5 * (now.intrinsics.fx + now.intrinsics.fy)
    px = np.sqrt(squares.sum(axis=1) / counts)
    mm = 1e3 * np.sqrt((squares * (depths / focal) ** 2).sum(axis=1) / counts)
    own = _own_residuals(model, fitted)
    typical = float(np.median(own))
    slips = logs(now.slips)
    result = []
    for row, name in enumerate(observations.names):
        reason = ""
        if fitted.distances[row] > DISAGREES:
            if own[row] > _BAD_POINTS * typical:
                reason = f"the points do not fit the target by {own[row]:.1f} px: it is blurred, hidden or bent there"
            else:
                away, turned = float(np.linalg.norm(slips[row, :3])), float(np.linalg.norm(slips[row, 3:]))
                reason = (
                    f"its pose is off by {1e3 * away:.1f} mm and {math.degrees(turned):.2f} degrees: "
                    "did the robot still move, or does the pose belong to another image?"
                )
        weight = min(1.0, float(fitted.weights.views[row]))
        result.append(
            ViewReport(
                name, float(px[row]), float(own[row]), float(mm[row]), float(fitted.distances[row]), weight, reason
            )
        )
    return tuple(result)


def _own_residuals(model: ViewModel, fitted: Fitted) -> Array:
    """(v,) px, root mean squares around the best pose of each view alone."""
    observations, lens = model.observations, fitted.parameters.intrinsics
    found = np.empty(len(observations))
    for row in range(len(observations)):
        one, seen = observations.subset([row]), model.seen[row]
        try:
            poses = target_poses(one, lens)[0]
        except ConfigError:
            found[row] = math.inf
            continue
        points = observations.points[seen]
        off = [lens.project(points @ pose[:3, :3].T + pose[:3, 3]) - observations.pixels[row][seen] for pose in poses]
        found[row] = min(math.sqrt(float((each**2).sum(axis=1).mean())) for each in off)
    return found


def _problem(views: Sequence[ViewReport], stds: Array) -> str:
    dropped = [view.image for view in views if view.drop]
    if 3 * len(dropped) > len(views):
        return f"{len(dropped)} of {len(views)} views disagree with the others: nobody can tell which are right"
    away, turned = float(stds[:3].max()), math.degrees(float(stds[3:6].max()))
    if away > _MOST_M or turned > _MOST_DEG:
        axis = "xyz"[int(stds[:3].argmax())] if away > _MOST_M else "xyz"[int(stds[3:6].argmax())]
        return (
            f"the views do not determine the mount well: {1e3 * away:.1f} mm and {turned:.2f} degrees (one standard "
            f"deviation), worst {'along' if away > _MOST_M else 'about'} the camera's {axis} axis"
        )
    return ""


def _numbers(matrix: Array) -> tuple[float, ...]:
    pose = Pose.from_matrix(matrix)
    return (*pose.t, *pose.q)
