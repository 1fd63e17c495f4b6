"""Rigid transforms in space, SE(3), with covariance: the values of geometric edges.

Poses are named destination-from-source: `world_from_cube = world_from_camera @ camera_from_cube`.
Covariances describe a right perturbation, T = T_mean exp(xi) with xi = (translation xyz in m, rotation
xyz in rad) expressed in the child frame, and are propagated to first order by the adjoint (Barfoot and
Furgale, "Associating Uncertainty With Three-Dimensional Poses for Use in Estimation Problems", T-RO
2014, there for left perturbations).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from typing import Any, NoReturn, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3, conjugate, normalised, product, rotate

Covariance = tuple[float, ...]
"""36 floats, a symmetric (6, 6) matrix row by row."""
Array = NDArray[np.float64]

_NORM_TOLERANCE = 1e-3
_SYMMETRY_TOLERANCE = 1e-6  # relative to the largest entry
_STRAIGHT = 1e-6  # sine of the angle between two directions that count as one
_SMALL_ANGLE = 1e-3  # rad, below which series replace quotients of small numbers


@final
class Pose:
    """A pose of a child frame in its parent frame: an immutable parent_from_child transform.

    Args:
        translation: (3,) origin of the child in the parent, m.
        rotation: (4,) unit quaternion (x, y, z, w). Off the unit norm by less than 1e-3, it is normalised.
        stamp: s, when this was so. 0.0 means that it always is (a static transform).
        covariance: (6, 6), or its 36 entries row by row, of a right perturbation (m, rad); None is unknown.

    Raises:
        ValueError: for values that are not finite, not of that shape, no rotation or no covariance.

    `==` and `hash` go by the numbers: use `distance` to learn whether two poses are close.
    """

    __slots__ = ("cov", "q", "stamp", "t")
    __array_ufunc__ = None  # lets `pose @ array` be a TypeError instead of numpy's attempt at it

    t: Vector3
    """Translation, m."""
    q: Quaternion
    """Rotation (x, y, z, w)."""
    stamp: float
    """s, when this was so; 0.0 if always."""
    cov: Covariance | None
    """Covariance, 36 entries row by row, m and rad."""

    def __init__(
        self,
        translation: Iterable[float] = (0.0, 0.0, 0.0),
        rotation: Iterable[float] = (0.0, 0.0, 0.0, 1.0),
        stamp: float = 0.0,
        covariance: ArrayLike | None = None,
    ) -> None:
        tx, ty, tz = _floats("translation", translation, 3)
        x, y, z, w = _floats("rotation", rotation, 4)
        q = normalised((x, y, z, w), _NORM_TOLERANCE)
        _set_t(self, (tx, ty, tz))
        _set_q(self, q)
        _set_stamp(self, stamp if type(stamp) is float and math.isfinite(stamp) else _float("stamp", stamp))
        _set_cov(self, None if covariance is None else _checked_covariance(covariance))

    @staticmethod
    def unchecked(t: Vector3, q: Quaternion, stamp: float = 0.0, cov: Covariance | None = None) -> Pose:
        """Make a pose of values known to be valid, at a fifth of the cost: for results of computations."""
        pose = _new(Pose)
        _set_t(pose, t)
        _set_q(pose, q)
        _set_stamp(pose, stamp)
        _set_cov(pose, cov)
        return pose

    @staticmethod
    def of_floats(t: Vector3, q: Quaternion, stamp: float, cov: Covariance) -> Pose:
        """Make a pose of plain floats that are finite, at half the cost: the rest is checked as by `Pose(...)`."""
        return Pose.unchecked(t, normalised(q, _NORM_TOLERANCE), stamp, _even(cov))

    @staticmethod
    def identity() -> Pose:
        """The static transform that moves nothing."""
        return _IDENTITY

    @staticmethod
    def from_matrix(matrix: ArrayLike, stamp: float = 0.0, covariance: ArrayLike | None = None) -> Pose:
        """Pose of a homogeneous (4, 4) matrix; ValueError unless it is rigid within 1e-3."""
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape != (4, 4) or not np.allclose(m[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
            raise ValueError(f"matrix {m.tolist()}: expected shape (4, 4) with last row (0, 0, 0, 1)")
        r = m[:3, :3]
        if not (np.allclose(r @ r.T, np.eye(3), rtol=0.0, atol=_NORM_TOLERANCE) and np.linalg.det(r) > 0.0):
            raise ValueError(f"matrix {m.tolist()}: its upper left (3, 3) part is no rotation")
        return Pose(m[:3, 3], quaternions.from_matrix(r.tolist()), stamp, covariance)

    @staticmethod
    def from_rotvec(
        translation: Iterable[float],
        rotvec: Iterable[float],
        stamp: float = 0.0,
        covariance: ArrayLike | None = None,
    ) -> Pose:
        """Pose with the rotation by |rotvec| rad about the axis rotvec (3,)."""
        x, y, z = _floats("rotvec", rotvec, 3)
        return Pose(translation, quaternions.from_rotvec((x, y, z)), stamp, covariance)

    @property
    def translation(self) -> Array:
        """(3,) origin of the child in the parent, m; read-only."""
        return _read_only(np.array(self.t))

    @property
    def rotation(self) -> Array:
        """(4,) unit quaternion (x, y, z, w); read-only."""
        return _read_only(np.array(self.q))

    @property
    def covariance(self) -> Array | None:
        """(6, 6) covariance of the right perturbation, m and rad, or None; read-only."""
        return None if self.cov is None else _read_only(np.array(self.cov).reshape(6, 6))

    def parent_covariances(self) -> tuple[Array, Array]:
        """Covariances (3, 3) of position (m^2) and rotation (rad^2) along the parent's axes.

        Raises:
            ValueError: without a covariance.
        """
        if self.cov is None:
            raise ValueError(f"{self} has no covariance")
        covariance, rotation = np.array(self.cov).reshape(6, 6), np.array(quaternions.to_matrix(self.q))
        return rotation @ covariance[:3, :3] @ rotation.T, rotation @ covariance[3:, 3:] @ rotation.T

    @property
    def rotation_matrix(self) -> Array:
        """(3, 3) matrix of the rotation; read-only."""
        return _read_only(np.array(quaternions.to_matrix(self.q)))

    @property
    def matrix(self) -> Array:
        """(4, 4) homogeneous matrix; read-only."""
        rows = zip(quaternions.to_matrix(self.q), self.t, strict=True)
        return _read_only(np.array([(*row, offset) for row, offset in rows] + [(0.0, 0.0, 0.0, 1.0)]))

    @property
    def rotvec(self) -> Array:
        """(3,) axis times angle of the rotation, rad, with an angle of at most pi; read-only."""
        return _read_only(np.array(quaternions.to_rotvec(self.q)))

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: a_from_c = a_from_b @ b_from_c. The older stamp that is not static holds.

        Covariances are taken as independent; one that is missing counts as exact unless both are.
        """
        if type(other) is not Pose:
            return NotImplemented
        # the arithmetic of `rotate` and `product`, for once without the calls, which would cost half as much again
        ax, ay, az, aw = self.q
        bx, by, bz, bw = other.q
        px, py, pz = other.t
        tx, ty, tz = self.t
        ux, uy, uz = 2.0 * (ay * pz - az * py), 2.0 * (az * px - ax * pz), 2.0 * (ax * py - ay * px)
        pose = _new(Pose)
        _set_t(
            pose,
            (
                tx + px + aw * ux + ay * uz - az * uy,
                ty + py + aw * uy + az * ux - ax * uz,
                tz + pz + aw * uz + ax * uy - ay * ux,
            ),
        )
        x = aw * bx + ax * bw + ay * bz - az * by
        y = aw * by - ax * bz + ay * bw + az * bx
        z = aw * bz + ax * by - ay * bx + az * bw
        w = aw * bw - ax * bx - ay * by - az * bz
        _set_q(pose, normalised((x, y, z, w)))
        a, b = self.stamp, other.stamp
        _set_stamp(pose, b if a == 0.0 or 0.0 != b < a else a)
        _set_cov(pose, other.cov if self.cov is None else _composed_covariance(self.cov, other))
        return pose

    def inverse(self) -> Pose:
        """child_from_parent, with the same stamp."""
        q = conjugate(self.q)
        tx, ty, tz = rotate(q, self.t)
        cov = None if self.cov is None else _transported(_adjoint(self), self.cov)
        return Pose.unchecked((-tx, -ty, -tz), q, self.stamp, cov)

    def apply(self, points: ArrayLike) -> Array:
        """Points (n, 3) or (3,) given in the child frame, in the parent frame; m."""
        result: Array = np.asarray(points, dtype=np.float64) @ self.rotation_matrix.T + self.t
        return result

    def distance(self, other: Pose) -> tuple[float, float]:
        """How far the two are apart: between origins in m, and angle in rad (0 to pi)."""
        between = product(conjugate(self.q), other.q)
        return math.dist(self.t, other.t), math.hypot(*quaternions.to_rotvec(between))

    def with_stamp(self, stamp: float) -> Pose:
        """The same transform at another time, s."""
        return Pose.unchecked(self.t, self.q, _float("stamp", stamp), self.cov)

    def with_covariance(self, covariance: ArrayLike | None) -> Pose:
        """The same transform with another (6, 6) covariance, or without."""
        cov = None if covariance is None else _checked_covariance(covariance)
        return Pose.unchecked(self.t, self.q, self.stamp, cov)

    def __eq__(self, other: object) -> bool:
        if type(other) is not Pose:
            return NotImplemented
        return self._values() == other._values()

    def __hash__(self) -> int:
        return hash(self._values())

    def __repr__(self) -> str:
        covariance = "" if self.cov is None else f", covariance={self.cov}"
        return f"Pose({self.t}, {self.q}, stamp={self.stamp}{covariance})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Pose, self._values()

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError(f"a Pose is immutable: cannot set {name!r}; make another one")

    def __delattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"a Pose is immutable: cannot delete {name!r}")

    def _values(self) -> tuple[Vector3, Quaternion, float, Covariance | None]:
        return self.t, self.q, self.stamp, self.cov


_new = object.__new__
_set_t, _set_q, _set_stamp, _set_cov = (Pose.__dict__[name].__set__ for name in ("t", "q", "stamp", "cov"))
_IDENTITY = Pose.unchecked((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def interpolate(a: Pose, b: Pose, at: float) -> Pose:
    """The pose at time `at` (s) between two samples: linear in translation, slerp along the shorter arc.

    The covariance is the linear blend, which bounds that of the interpolated pose however the errors of
    the two samples are correlated; with one sample's covariance unknown, the other's holds.

    Raises:
        ValueError: if `at` is not within [a.stamp, b.stamp].
    """
    if not a.stamp <= at <= b.stamp:
        raise ValueError(f"cannot interpolate at {at} s between samples at {a.stamp} s and {b.stamp} s")
    if at in (a.stamp, b.stamp):
        return a if at == a.stamp else b
    s = (at - a.stamp) / (b.stamp - a.stamp)
    ax, ay, az = a.t
    bx, by, bz = b.t
    t = (ax + s * (bx - ax), ay + s * (by - ay), az + s * (bz - az))
    return Pose.unchecked(t, quaternions.slerp(a.q, b.q, s), at, _blended_covariance(a.cov, b.cov, s))


def looking_at(eye: Vector3, target: Vector3, up: Vector3 = (0.0, 0.0, 1.0)) -> Pose:
    """world_from_camera of an optical frame (z forward, x right, y down) at `eye` with `target` (m) in its middle.

    The camera is upright: its x axis is perpendicular to `up`. Of one that looks along the world's z axis, the upper
    side of the image is world +x.
    """
    forward = np.subtract(target, eye)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < _STRAIGHT:
        right = np.array([0.0, math.copysign(1.0, forward[2]), 0.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    matrix[:3, 3] = eye
    return Pose.from_matrix(matrix)


def position_deviation(pose: Pose) -> float:
    """Standard deviation of the position, m: the root of the mean variance along the three axes; 0 if unknown."""
    return 0.0 if pose.cov is None else math.sqrt((pose.cov[0] + pose.cov[7] + pose.cov[14]) / 3.0)


def exp(twist: Iterable[float]) -> Pose:
    """SE(3) exponential of a (6,) twist (translation m, rotation rad); Barfoot and Furgale 2014, eq. 8."""
    rx, ry, rz, x, y, z = _floats("twist", twist, 6)
    rho, phi = (rx, ry, rz), (x, y, z)
    angle = math.hypot(*phi)
    if angle < _SMALL_ANGLE:
        b, c = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
    else:
        b, c = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    return Pose.unchecked(quaternions.left_jacobian(rho, phi, b, c), quaternions.from_rotvec(phi))


def log(pose: Pose) -> Array:
    """(6,) twist (translation m, rotation rad) whose `exp` is `pose`, with an angle of at most pi."""
    phi = quaternions.to_rotvec(pose.q)
    angle = math.hypot(*phi)
    if angle < _SMALL_ANGLE:
        c = 1.0 / 12.0 + angle**2 / 720.0
    else:
        c = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2
    return np.array(quaternions.left_jacobian(pose.t, phi, -0.5, c) + phi)


def _floats(name: str, values: Iterable[float], count: int) -> tuple[float, ...]:
    """The values as `count` finite plain floats, or a ValueError that names them."""
    try:
        result = tuple(map(float, values.tolist() if isinstance(values, np.ndarray) else values))
    except (TypeError, ValueError):
        raise ValueError(f"{name} {values!r}: expected {count} numbers") from None
    if len(result) != count or not math.isfinite(sum(result)):
        raise ValueError(f"{name} {values!r}: expected {count} finite numbers")
    return result


def _float(name: str, value: float) -> float:
    """The value as a finite plain float, or a ValueError that names it."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} {value!r}: expected a number") from None
    if not math.isfinite(result):
        raise ValueError(f"{name} {value!r}: expected a finite number")
    return result


def _checked_covariance(covariance: ArrayLike) -> Covariance:
    """36 floats of a symmetric matrix with no negative variance."""
    return _even(_floats("covariance", _flat36(covariance), 36))


def _even(cov: Covariance) -> Covariance:
    """The covariance without asymmetry by rounding; a ValueError if it has more, or a negative variance."""
    transposed = cov[0::6] + cov[1::6] + cov[2::6] + cov[3::6] + cov[4::6] + cov[5::6]
    if min(cov[::7]) < 0.0:
        raise ValueError(f"covariance with diagonal {cov[::7]}: variances cannot be negative")
    if transposed == cov:
        return cov
    worst = max(map(abs, map(operator.sub, cov, transposed)))
    if worst > _SYMMETRY_TOLERANCE * max(map(abs, cov)):
        raise ValueError(f"covariance {cov} is not symmetric: entries differ by up to {worst:.3g}")
    return tuple(0.5 * both for both in map(operator.add, cov, transposed))


def _flat36(covariance: ArrayLike) -> Iterable[float]:
    """The entries row by row, of a shape that is (6, 6) or (36,)."""
    if isinstance(covariance, tuple) and len(covariance) == 36:
        return covariance
    try:
        array = np.asarray(covariance, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"covariance {covariance!r}: expected (6, 6) numbers") from None
    if array.shape not in ((6, 6), (36,)):
        raise ValueError(f"covariance of shape {array.shape}: expected (6, 6)")
    return array.ravel()


def _read_only(array: Array) -> Array:
    array.flags.writeable = False
    return array


def _adjoint(pose: Pose) -> Array:
    """(6, 6) matrix that moves a twist from the child frame to the parent: T exp(xi) = exp(Ad xi) T."""
    rotation = np.array(quaternions.to_matrix(pose.q))
    x, y, z = pose.t
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = rotation
    adjoint[:3, 3:] = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))) @ rotation
    return adjoint


def _transported(adjoint: Array, cov: Covariance) -> Covariance:
    """Adjoint C Adjoint^T, exactly symmetric and, in spite of rounding, without a negative variance."""
    moved = adjoint @ np.array(cov).reshape(6, 6) @ adjoint.T
    moved = 0.5 * (moved + moved.T)
    np.fill_diagonal(moved, np.maximum(moved.diagonal(), 0.0))
    return tuple(moved.ravel().tolist())


def _composed_covariance(cov: Covariance, other: Pose) -> Covariance:
    """Covariance of T @ other: that of T seen from the far side of `other`, plus the other's own."""
    moved = _transported(_adjoint(other.with_covariance(None).inverse()), cov)
    return moved if other.cov is None else tuple(a + b for a, b in zip(moved, other.cov, strict=True))


def _blended_covariance(a: Covariance | None, b: Covariance | None, s: float) -> Covariance | None:
    if a is None or b is None:
        return b if a is None else a
    return tuple((1.0 - s) * x + s * y for x, y in zip(a, b, strict=True))
