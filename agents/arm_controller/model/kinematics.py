"""Forward and inverse kinematics of any serial chain of joints.

The inverse is damped least squares with the damping of T. Sugihara, "Solvability-Unconcerned Inverse
Kinematics by the Levenberg-Marquardt Method", IEEE T-RO 2011: the squared error itself damps, so that it
converges quadratically near a solution and stays calm at singularities and beyond reach. All starting
points are iterated together, as one batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.arm_controller.model.urdf import Joint
from dsr.errors import ConfigError, DsrError
from dsr.math3d.batches import rotvecs, skew
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

POSITION_TOLERANCE = 1e-5
"""m, residual of a solution"""
USUAL_SPEED = 1.0
"""rad/s or m/s, the most of a joint whose description gives none: what slow arms do"""
ROTATION_TOLERANCE = 1e-4
"""rad, residual of a solution"""
_MOST_STEPS = 100
_LONGEST_STEP = 0.5  # rad or m per joint and iteration
_LEAST_DAMPING = 1e-8
_POSTURE_GAIN = 0.1
_PATIENCE = 10  # iterations for which other starting points go on once one has converged


class UnreachableError(DsrError):
    """No joint positions bring the tip to the target.

    Args:
        position: m, what remains at the closest ones found.
        rotation: rad, likewise.
    """

    def __init__(self, position: float, rotation: float) -> None:
        super().__init__(f"out of reach: the closest pose found is {position * 1e3:.2f} mm and {rotation:.4f} rad away")
        self.position = position
        self.rotation = rotation


@dataclass(frozen=True)
class InverseSolution:
    """Joint positions that bring the tip to a target."""

    positions: tuple[float, ...]
    """rad or m, within the limits; those of continuous joints within half a turn of the start"""
    position_error: float
    """Distance of the tip from the target, m."""
    rotation_error: float
    """Angle of the tip to the target, rad."""


class JointChain:
    """A serial chain of joints from a base link to a tip link.

    Args:
        joints: from base to tip, fixed ones included (`Robot.between`).
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.moving = tuple(joint for joint in joints if joint.moves)
        """All joints that move, from base to tip."""
        self.joints = tuple(joint for joint in self.moving if joint.mimic is None)
        """Those that have a position of their own: all but those that mimic one of them."""
        self.names = tuple(joint.name for joint in self.joints)
        self.gears, self._offsets = _gears(self.moving, self.names)
        """(k, n) velocities of all joints that move, per velocity of those with a position of their own"""
        self.lower, self.upper = _ranges(self.moving, self.names)
        self.velocity = _fastest(self.moving, self.names)
        """(n,) rad/s or m/s, the most of each joint with a position of its own"""
        self.turning = np.isinf(self.lower)
        """Which joints are continuous"""
        self._prismatic = np.array([joint.kind == "prismatic" for joint in self.moving])
        self._axes = np.array([joint.axis for joint in self.moving]).reshape(-1, 3)
        self._skew = skew(self._axes)
        self._skew2 = self._skew @ self._skew
        self._origins, self._tip = _origins(joints)

    def __len__(self) -> int:
        return len(self.joints)

    def all_positions(self, positions: ArrayLike) -> Array:
        """(k,) of all that move, also those that mimic others, for `positions` (n,)."""
        return np.asarray(self.gears @ np.asarray(positions, dtype=np.float64) + self._offsets)

    def forward(self, positions: ArrayLike) -> Pose:
        """base_from_tip at joint `positions` (n,), rad or m."""
        return Pose.from_matrix(self._frames(_row(positions))[0, -1])

    def frames(self, positions: Array) -> Array:
        """(m, k + 2, 4, 4) base_from_link of the base, k moving links and the tip at joint `positions` (m, n)."""
        frames = self._frames(positions)
        base = np.broadcast_to(np.eye(4), (len(frames), 1, 4, 4))
        return np.concatenate([base, frames], axis=1)

    def jacobian(self, positions: ArrayLike) -> Array:
        """(6, n) velocity of the tip (m/s, rad/s, in the base frame) per joint velocity."""
        jacobian: Array = self._jacobian(self._frames(_row(positions)))[0]
        return jacobian

    def difference(self, a: ArrayLike, b: ArrayLike) -> Array:
        """(n,) way from joint positions `a` to `b`, the shorter way round for continuous joints."""
        difference = np.asarray(b, dtype=float) - np.asarray(a, dtype=float)
        return np.where(self.turning, _wrapped(difference), difference)

    def inverse(
        self,
        base_from_tip: Pose,
        start: ArrayLike,
        *,
        rng: np.random.Generator,
        posture: ArrayLike | None = None,
        restarts: int = 23,
    ) -> InverseSolution:
        """Joint positions that bring the tip to `base_from_tip`.

        Of the solutions found it is the one that takes the joints the least far from `start`.

        Args:
            base_from_tip: the target.
            start: (n,) where the joints are, rad or m.
            rng: draws the other starting points.
            posture: (n,) wanted as far as the target leaves freedom; `start` if None.
            restarts: how many other starting points.

        Raises:
            UnreachableError: with the smallest residual found.
        """
        first = np.asarray(start, dtype=float)
        wanted = first if posture is None else first + self.difference(first, posture)
        q = self.starts(first, restarts, rng)
        q, errors = self._iterate(q, base_from_tip.matrix, wanted)
        q = np.where(self.turning, first + _wrapped(q - first), q)
        distance, angle = _residuals(errors)
        reached = _reached(errors)
        if not reached.any():
            best = int(np.argmin(distance + angle))
            raise UnreachableError(float(distance[best]), float(angle[best]))
        best = int(np.argmin(np.where(reached, np.abs(q - first).max(axis=1), np.inf)))
        return InverseSolution(tuple(q[best].tolist()), float(distance[best]), float(angle[best]))

    def track(self, base_from_tips: Array, starts: Array, posture: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Joint positions (m, n) that bring the tip to each of (m, 4, 4), the ones that the iteration leads to.

        Args:
            base_from_tips: the targets.
            starts: (m, n) where the search for each begins.
            posture: (n,) wanted as far as a target leaves freedom.

        Returns:
            The positions, those of continuous joints within half a turn of the start, and (m,) which are solutions.
        """
        near = starts + np.where(self.turning, _wrapped(np.asarray(posture) - starts), np.asarray(posture) - starts)
        q, errors = self._iterate(starts, base_from_tips, near, patient=True)
        return np.where(self.turning, starts + _wrapped(q - starts), q), _reached(errors)

    def starts(self, first: Array, restarts: int, rng: np.random.Generator) -> Array:
        """(1 + restarts, n) joint positions to begin a search at, `first` (n,) in front, the others at random."""
        lower = np.where(self.turning, first - np.pi, self.lower)
        upper = np.where(self.turning, first + np.pi, self.upper)
        others = rng.uniform(lower, upper, (restarts, len(self)))
        return np.clip(np.vstack([first, others]), self.lower, self.upper)

    def _iterate(self, q: Array, target: Array, posture: Array, patient: bool = False) -> tuple[Array, Array]:
        """Improve all rows of `q` (m, n) at once, until one is good enough, or all that can be if `patient`.

        The target, (4, 4) or (m, 4, 4), and the posture, (n,) or (m, n), are one for all or for each of them.
        Returns the rows with their errors (m, 6).
        """
        patience = _MOST_STEPS if patient else _PATIENCE
        for _ in range(_MOST_STEPS):
            frames = self._frames(q)
            errors = _errors(frames[:, -1], target)
            reached = _reached(errors)
            patience -= bool(reached.any())
            if (reached[0] and not patient) or reached.all() or patience < 0:
                return q, errors
            jacobian = self._jacobian(frames)
            step = _step(jacobian, errors, posture - q)
            blocked = (q + step < self.lower) & (q <= self.lower) | (q + step > self.upper) & (q >= self.upper)
            step = _step(np.where(blocked[:, None], 0.0, jacobian), errors, np.where(blocked, 0.0, posture - q))
            step *= np.minimum(1.0, _LONGEST_STEP / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
            q = np.where(reached[:, None], q, np.clip(q + step, self.lower, self.upper))
        return q, _errors(self._frames(q)[:, -1], target)

    def _frames(self, q: Array) -> Array:
        """(m, k + 1, 4, 4) base_from_joint frame of each joint after its motion, and of the tip, for q (m, n)."""
        motions = self._motions(q @ self.gears.T + self._offsets)
        frames = np.empty((len(q), len(self.moving) + 1, 4, 4))
        frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for index, origin in enumerate(self._origins):
            frame = frame @ origin @ motions[:, index]
            frames[:, index] = frame
        frames[:, -1] = frame @ self._tip
        return frames

    def _motions(self, q: Array) -> Array:
        """(m, k, 4, 4) transform of each joint by its position (m, k) alone (rotations by Rodrigues' formula)."""
        angle = np.where(self._prismatic, 0.0, q)[..., None, None]
        motions = np.zeros((*q.shape, 4, 4))
        motions[..., :3, :3] = np.eye(3) + np.sin(angle) * self._skew + (1.0 - np.cos(angle)) * self._skew2
        motions[..., :3, 3] = np.where(self._prismatic, q, 0.0)[..., None] * self._axes
        motions[..., 3, 3] = 1.0
        return motions

    def _jacobian(self, frames: Array) -> Array:
        """(m, 6, n) of frames (m, k + 1, 4, 4)."""
        axes = np.einsum("mnij,nj->mni", frames[:, :-1, :3, :3], self._axes)
        lever = frames[:, -1:, :3, 3] - frames[:, :-1, :3, 3]
        slides = self._prismatic[:, None]
        linear = np.where(slides, axes, np.cross(axes, lever))
        each = np.concatenate([linear, np.where(slides, 0.0, axes)], axis=2)  # (m, k, 6)
        return np.asarray(each.transpose(0, 2, 1) @ self.gears)


def _step(jacobian: Array, errors: Array, to_posture: Array) -> Array:
    """(m, n) damped least squares step, with a step to the posture where that moves the tip not."""
    energy = 0.5 * np.einsum("mi,mi->m", errors, errors) + _LEAST_DAMPING
    transposed = jacobian.transpose(0, 2, 1)
    damped = jacobian @ transposed + energy[:, None, None] * np.eye(6)
    drift = _POSTURE_GAIN * to_posture
    rest = errors - np.einsum("mij,mj->mi", jacobian, drift)
    solved = np.linalg.solve(damped, rest[:, :, None])
    return drift + (transposed @ solved)[:, :, 0]


def _gears(moving: Sequence[Joint], names: Sequence[str]) -> tuple[Array, Array]:
    """(k, n) and (k,): positions of k joints that move are the matrix times those of n `names`, plus the offsets.

    Raises `ConfigError` for a joint that mimics one that is not among them.
    """
    gears, offsets = np.zeros((len(moving), len(names))), np.zeros(len(moving))
    for row, joint in enumerate(moving):
        master = joint.name if joint.mimic is None else joint.mimic.joint
        if master not in names:
            raise ConfigError(f"joint {joint.name!r} mimics {master!r}, which is no joint on the way to the tool")
        gears[row, names.index(master)] = 1.0 if joint.mimic is None else joint.mimic.multiplier
        offsets[row] = 0.0 if joint.mimic is None else joint.mimic.offset
    return gears, offsets


def _ranges(moving: Sequence[Joint], names: Sequence[str]) -> tuple[Array, Array]:
    """(n,) least and greatest positions of `names`: within their limits, and those of the joints that mimic them."""
    lower, upper = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for joint in moving:
        low, high = joint.lower, joint.upper
        if joint.mimic is not None:
            if not joint.mimic.multiplier:
                continue
            ends = ((end - joint.mimic.offset) / joint.mimic.multiplier for end in (low, high))
            low, high = sorted(ends)
        index = names.index(joint.name if joint.mimic is None else joint.mimic.joint)
        lower[index], upper[index] = max(lower[index], low), min(upper[index], high)
    return lower, upper


def _fastest(moving: Sequence[Joint], names: Sequence[str]) -> Array:
    """(n,) greatest velocities of `names`: within their limits, and those of the joints that mimic them."""
    fastest = np.full(len(names), np.inf)
    for joint in moving:
        gear = 1.0 if joint.mimic is None else abs(joint.mimic.multiplier)
        index = names.index(joint.name if joint.mimic is None else joint.mimic.joint)
        if gear:
            fastest[index] = min(fastest[index], joint.velocity / gear)
    return np.where(np.isinf(fastest), USUAL_SPEED, fastest)


def _origins(joints: Sequence[Joint]) -> tuple[list[Array], Array]:
    """(4, 4) transform before each moving joint, fixed ones folded in, and from the last one to the tip."""
    origins, before = [], Pose.identity()
    for joint in joints:
        before = before @ joint.origin
        if joint.moves:
            origins.append(before.matrix)
            before = Pose.identity()
    return origins, before.matrix


def _residuals(errors: Array) -> tuple[Array, Array]:
    """(m,) distances (m) and (m,) angles (rad) of errors (m, 6)."""
    return np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)


def _reached(errors: Array) -> NDArray[np.bool_]:
    """(m,) whether errors (m, 6) are within the tolerances."""
    distance, angle = _residuals(errors)
    reached: NDArray[np.bool_] = (distance <= POSITION_TOLERANCE) & (angle <= ROTATION_TOLERANCE)
    return reached


def _errors(base_from_tip: Array, target: Array) -> Array:
    """(m, 6) way (m) and rotation vector (rad), in the base frame, from tips (m, 4, 4) to the targets (.., 4, 4)."""
    translation = target[..., :3, 3] - base_from_tip[:, :3, 3]
    return np.concatenate(
        [translation, rotvecs(target[..., :3, :3] @ base_from_tip[:, :3, :3].transpose(0, 2, 1))], axis=1
    )


def _row(positions: ArrayLike) -> Array:
    """(1, n) of (n,)."""
    return np.asarray(positions, dtype=np.float64)[None]


def _wrapped(angles: Array) -> Array:
    """The same angles within half a turn of 0."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi
