"""Rotations as unit quaternions (x, y, z, w) on plain floats.

On three or four numbers plain floats are several times faster than numpy. Inputs are trusted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector3 = tuple[float, float, float]
Rows3 = tuple[Vector3, Vector3, Vector3]
"""A (3, 3) matrix row by row."""
Quaternion = tuple[float, float, float, float]
"""(x, y, z, w), of unit norm."""

_NORM_EXACT = 1e-12  # squared norms this close to 1 are left alone: a copy of a quaternion has the same bits
_NEARLY_PARALLEL = 1.0 - 1e-7  # cosine of the half angle above which slerp is linear to 1e-11

ANY_TURN = (math.pi**2 / 3.0 + 2.0) / 3.0
"""rad^2, variance about each axis of a rotation that is any one, as probable

The angle of such a rotation has the density (1 - cos angle) / pi from 0 to pi, and its axis any direction. So the
mean square of its angle is pi^2 / 3 + 2.
"""


def normalised(q: Quaternion, tolerance: float = math.inf) -> Quaternion:
    """Scale q to unit norm; the same object if it has it already, up to rounding. Zero is not accepted.

    Raises:
        ValueError: if the norm is off by `tolerance` or more.
    """
    x, y, z, w = q
    norm2 = x * x + y * y + z * z + w * w
    if -_NORM_EXACT < norm2 - 1.0 < _NORM_EXACT:
        return q
    norm = math.sqrt(norm2)
    if abs(norm - 1.0) >= tolerance:
        raise ValueError(f"rotation {q}: norm {norm:.6g}, expected 1 within {tolerance}")
    return x / norm, y / norm, z / norm, w / norm


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a unit quaternion: the rotation back."""
    x, y, z, w = q
    return -x, -y, -z, w


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product: first b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotate(q: Quaternion, v: Vector3) -> Vector3:
    """The vector v, rotated by q."""
    x, y, z, w = q
    px, py, pz = v
    ux, uy, uz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return px + w * ux + y * uz - z * uy, py + w * uy + z * ux - x * uz, pz + w * uz + x * uy - y * ux


def to_matrix(q: Quaternion) -> Rows3:
    """(3, 3) rotation matrix of q."""
    x, y, z, w = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


def from_matrix(r: Sequence[Sequence[float]]) -> Quaternion:
    """Unit quaternion of a (3, 3) rotation, from its largest component (Shepperd 1978)."""
    trace = r[0][0] + r[1][1] + r[2][2]
    largest = max(r[0][0], r[1][1], r[2][2], trace)
    q = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1], 1.0 + trace]
    if largest != trace:
        i = next(i for i in range(3) if r[i][i] == largest)
        j, k = (i + 1) % 3, (i + 2) % 3
        q[3] = r[k][j] - r[j][k]
        q[i], q[j], q[k] = 1.0 + r[i][i] - r[j][j] - r[k][k], r[i][j] + r[j][i], r[i][k] + r[k][i]
    return normalised((q[0], q[1], q[2], q[3]))


def from_rotvec(rotvec: Vector3) -> Quaternion:
    """Rotation by |rotvec| rad about the axis rotvec."""
    x, y, z = rotvec
    angle = math.hypot(x, y, z)
    scale = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return scale * x, scale * y, scale * z, math.cos(0.5 * angle)


def to_rotvec(q: Quaternion) -> Vector3:
    """Axis times angle (rad), with an angle of at most pi."""
    x, y, z, w = q
    sine = math.hypot(x, y, z)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    scale = math.copysign(2.0, w) * math.atan2(sine, abs(w)) / sine
    return scale * x, scale * y, scale * z


def about_z(q: Quaternion) -> Quaternion:
    """The yaw of q: the rotation about z that is left of it without its tilt; none if it turns z downwards."""
    _, _, z, w = q
    norm = math.hypot(z, w)
    return (0.0, 0.0, z / norm, w / norm) if norm > 0.0 else (0.0, 0.0, 0.0, 1.0)


def left_jacobian(v: Vector3, phi: Vector3, b: float, c: float) -> Vector3:
    """The left Jacobian of SO(3), or its inverse, times v: v + b phi x v + c phi x (phi x v)."""
    x, y, z = phi
    u = (y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0])
    return (
        v[0] + b * u[0] + c * (y * u[2] - z * u[1]),
        v[1] + b * u[1] + c * (z * u[0] - x * u[2]),
        v[2] + b * u[2] + c * (x * u[1] - y * u[0]),
    )


def slerp(a: Quaternion, b: Quaternion, s: float) -> Quaternion:
    """From a (s = 0) to b (s = 1) along the shorter arc at constant speed (Shoemake 1985)."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign, cosine = (-1.0, -cosine) if cosine < 0.0 else (1.0, cosine)
    if cosine > _NEARLY_PARALLEL:
        wa, wb = 1.0 - s, s
    else:
        angle = math.acos(cosine)
        wa, wb = math.sin((1.0 - s) * angle), math.sin(s * angle)
    wb *= sign
    return normalised(
        (wa * a[0] + wb * b[0], wa * a[1] + wb * b[1], wa * a[2] + wb * b[2], wa * a[3] + wb * b[3])
    )
