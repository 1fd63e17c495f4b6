"""Poses of CORTEX graph files: millimetres and Euler angles."""

from __future__ import annotations

import contextlib
import warnings
from decimal import Decimal
from typing import Any

from dsr.graph.schema import Value
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from dsr.persistence.cortex_values import DOUBLE, FLOATS, Note, Origin, to_ours, to_theirs

TRANSLATION, ROTATION = "rt_translation", "rt_rotation_euler_xyz"
"""mm; rad, about the moving axes x, y, z in turn"""
STAMP, COVARIANCE = "rt_stamp", "rt_covariance"
"""s; m and rad, 36 entries row by row. CORTEX does not know them."""
POSE_CODES = {TRANSLATION: FLOATS, ROTATION: FLOATS, STAMP: DOUBLE, COVARIANCE: FLOATS}
"""Attributes that make up the pose of a link, with the codes that they are written with."""


def pose_of(attributes: dict[str, Any]) -> tuple[Pose | None, dict[str, int]]:
    """The pose of a link and the codes of the attributes that it holds; none unless all of them can be told again."""
    usual = {name: value for name in POSE_CODES if (value := _usual(attributes.get(name))) is not None}
    if not all(isinstance(usual.get(name), tuple) and len(usual[name]) == 3 for name in (TRANSLATION, ROTATION)):
        return None, {}
    pose, taken = _to_pose(usual[TRANSLATION], usual[ROTATION]), [TRANSLATION, ROTATION]
    if isinstance(stamp := usual.get(STAMP), float) and stamp:
        pose, taken = pose.with_stamp(stamp), [*taken, STAMP]
    with contextlib.suppress(ValueError):
        uncertain = pose.with_covariance(usual.get(COVARIANCE))
        if uncertain.cov is not None and uncertain.cov == usual[COVARIANCE]:
            pose, taken = uncertain, [*taken, COVARIANCE]
    return pose, {name: attributes[name]["type"] for name in taken}


def _usual(attribute: Any) -> Any:
    """The value of an attribute that has nothing unusual about it; None for others."""
    if not isinstance(attribute, dict) or attribute.keys() != {"type", "value"}:
        return None
    try:
        return to_ours(attribute["type"], attribute["value"])[1]
    except (ValueError, TypeError):
        return None


def pose_attributes(pose: Pose, note: Note) -> dict[str, Any]:
    """The attributes of a link that say where its destination is; the inverse of `pose_of`."""
    values: dict[str, Value] = {TRANSLATION: _in_millimetres(pose.t), ROTATION: _euler_angles(pose.q)}
    if pose.stamp:
        values[STAMP] = pose.stamp
    if pose.cov is not None:
        values[COVARIANCE] = pose.cov
    return {
        name: to_theirs(value, note.attributes.get(name, Origin(POSE_CODES[name]))) for name, value in values.items()
    }


def _to_pose(translation: Vector3, angles: Vector3) -> Pose:
    """A static pose from mm, and rad about the moving axes x, y, z in turn."""
    from scipy.spatial.transform import Rotation  # takes half a second, which most processes need not wait for

    metres = [_shifted(number, -3) for number in translation]
    return Pose(metres, Rotation.from_euler("XYZ", angles).as_quat().tolist())


def _in_millimetres(translation: Vector3) -> tuple[float, ...]:
    """Metres as mm."""
    return tuple(_shifted(number, 3) for number in translation)


def _euler_angles(rotation: Quaternion) -> tuple[float, ...]:
    """Angles in rad about the moving axes x, y, z in turn; in gimbal lock the third is 0."""
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # gimbal lock: any solution will do
        return tuple(Rotation.from_quat(rotation).as_euler("XYZ").tolist())


def _shifted(number: float, places: int) -> float:
    """`number` times 10**places in decimal: 79.99 mm becomes 0.07999 m, and 79.99 mm again."""
    return float(Decimal(repr(number)).scaleb(places))
