"""Where a thing may be, as a distribution: alternatives with weights, and their form as an attribute of its node."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from dsr.errors import WireError
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import MAX_NUMBER, is_within_bounds
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Array, Pose
from dsr.network.decoding import decoded as decoded_text

ATTRIBUTE = "whereabouts"
"""Of a thing's node: its alternatives as JSON, while there is more than one. See `whereabouts_of`."""
_MOST_BYTES = 64_000  # of that attribute
_MOST = 64  # alternatives, and things of an island
SAME_PLACE = PoseTolerance(0.001, 0.01)
"""m, rad up to which two places of a thing are one"""
_UPPER = np.triu_indices(6)
_ROUNDING = 1e-3  # 1, by which the sum of weights may be off


class Alternative(msgspec.Struct, frozen=True, kw_only=True):
    """One way in which a thing may be."""

    weight: float
    """1, its probability"""
    pose: Pose | None
    """world_from_thing, with covariance (m, rad) if that is known; None if the thing is gone"""
    reason: str = ""
    """What would have happened, or what this rests on, for people"""
    hand: str = ""
    """Name of the hand or gripper that holds the thing; empty for none"""
    containers: tuple[str, ...] = ()
    """Names of what it is in, the innermost first"""
    supports: tuple[str, ...] = ()
    """Names of what it rests on, but for the floor"""
    worlds: tuple[int, ...] = (0,)
    """Indexes of the worlds of its island in which the thing is so; 0 is the most probable one"""

    @property
    def is_gone(self) -> bool:
        """Whether the thing is not in the scene any more."""
        return self.pose is None

    @property
    def holders(self) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
        """Hand, containers and supports."""
        return self.hand, self.containers, self.supports


class Whereabouts(msgspec.Struct, frozen=True):
    """The distribution of one thing.

    Raises:
        ValueError: without alternatives, or for weights that are no probabilities of alternatives.
    """

    name: str
    """Name of the thing"""
    alternatives: tuple[Alternative, ...]
    """The most probable first; their weights sum to 1"""
    island: tuple[str, ...] = ()
    """Names of the things that are judged together with this one, itself among them"""
    weights: tuple[float, ...] = (1.0,)
    """Probabilities of the worlds of the island, the most probable first"""

    def __post_init__(self) -> None:
        own = [alternative.weight for alternative in self.alternatives]
        if not own or not all(0.0 <= weight <= 1.0 + _ROUNDING for weight in (*own, *self.weights)):
            raise ValueError(f"{self.name}: weights {own}; expected probabilities")
        if abs(sum(own) - 1.0) > _ROUNDING:
            raise ValueError(f"{self.name}: weights sum to {sum(own):g}; expected 1")

    @property
    def best(self) -> Alternative:
        """The most probable alternative."""
        return self.alternatives[0]

    @property
    def gone(self) -> float:
        """Probability that the thing is not in the scene any more."""
        return sum(alternative.weight for alternative in self.alternatives if alternative.is_gone)

    def samples(self, count: int, seed: int) -> list[Pose | None]:
        """Draw poses (world_from_thing) independently; None where the thing is gone. The same seed draws the same."""
        random = np.random.default_rng(seed)
        weights = np.array([alternative.weight for alternative in self.alternatives])
        chosen = random.choice(len(weights), count, p=weights / weights.sum())
        return [_drawn(self.alternatives[index].pose, random) for index in chosen]


def whereabouts_of(node: Node, believed: Edge | None) -> Whereabouts | None:
    """The distribution that the graph holds of a thing.

    Args:
        node: of the thing.
        believed: its edge Virtual_RT from the world, which has the pose of what has no place in the attribute.

    Returns:
        None if nothing is believed of it, or what its node says cannot be used.
    """
    pose: Pose | None = None if believed is None else believed.get("pose")
    gone = node.get("present") is False
    told = node.get(ATTRIBUTE)
    if isinstance(told, str) and told:
        return decoded(node.name, told, None if gone else pose)
    if pose is None and not gone:
        return None
    return Whereabouts(node.name, (Alternative(weight=1.0, pose=None if gone else pose),), (node.name,))


class _WrittenAlternative(msgspec.Struct, frozen=True, omit_defaults=True):
    """An alternative as JSON. Without a place, and not gone, it is where the edge Virtual_RT says.

    Without a covariance it has that of the edge.
    """

    weight: float
    worlds: tuple[int, ...] = (0,)
    gone: bool = False
    at: Vector3 | None = None
    turn: Quaternion = (0.0, 0.0, 0.0, 1.0)
    covariance: tuple[float, ...] = ()
    """Upper triangle, row by row"""
    reason: str = ""
    hand: str = ""
    containers: tuple[str, ...] = ()
    supports: tuple[str, ...] = ()


class _Written(msgspec.Struct, frozen=True):
    island: tuple[str, ...]
    weights: tuple[float, ...]
    alternatives: tuple[_WrittenAlternative, ...]


_decoder = msgspec.json.Decoder(_Written)


def encoded(whereabouts: Whereabouts, believed: Pose | None = None) -> str:
    """The attribute. It has no place for what is where the edge Virtual_RT says: `believed`, or else the best place."""
    best = whereabouts.best
    shown = best if believed is None else Alternative(weight=0.0, pose=believed)
    written = [_written(one, shown, is_best=one is best) for one in whereabouts.alternatives]
    weights = tuple(round(weight, 4) for weight in whereabouts.weights)
    return msgspec.json.encode(_Written(whereabouts.island, weights, tuple(written))).decode()


def decoded(name: str, text: str, believed: Pose | None) -> Whereabouts | None:
    """The distribution of a thing by its attribute and its believed pose; None if the attribute cannot be used."""
    if len(text) > _MOST_BYTES:
        return None
    try:
        written = decoded_text(text, "whereabouts", _decoder.decode)
        if not 0 < len(written.alternatives) <= _MOST or len(written.island) > _MOST:
            return None
        found = [_read(one, believed) for one in written.alternatives]
        total = sum(one.weight for one in found)
        if not math.isfinite(total) or total <= 0.0:
            return None
        alternatives = tuple(msgspec.structs.replace(one, weight=one.weight / total) for one in found)
        return Whereabouts(name, alternatives, written.island, written.weights)
    except (WireError, ValueError):
        return None


def are_at_one_place(one: Alternative, other: Alternative) -> bool:
    """Whether two alternatives differ at most in how exactly they tell the place."""
    if one.pose is None or other.pose is None:
        return one.pose is other.pose
    return SAME_PLACE.covers(one.pose, other.pose)


def _written(one: Alternative, shown: Alternative, *, is_best: bool) -> _WrittenAlternative:
    is_there = one.pose is None or are_at_one_place(one, shown)
    place = None if one.pose is None or is_there else _rounded(one.pose.t)
    turn = (0.0, 0.0, 0.0, 1.0) if one.pose is None or is_there else _rounded(one.pose.q)
    covariance: tuple[float, ...] = ()
    if one.pose is not None and one.pose.covariance is not None and not (is_best and is_there):
        covariance = tuple(float(f"{value:.3g}") for value in one.pose.covariance[_UPPER])
    return _WrittenAlternative(
        round(one.weight, 4), one.worlds, one.is_gone, place, turn, covariance,  # type: ignore[arg-type]
        one.reason, one.hand, one.containers, one.supports,
    )  # fmt: skip


def _read(one: _WrittenAlternative, believed: Pose | None) -> Alternative:
    pose = None if one.gone else believed
    if one.at is not None and not one.gone:
        pose = Pose(one.at, one.turn, 0.0 if believed is None else believed.stamp)
    if one.covariance and pose is not None:
        pose = pose.with_covariance(_whole(one.covariance))
    if pose is not None and not is_within_bounds(pose):
        raise ValueError(f"a place beyond {MAX_NUMBER:g} m")
    return Alternative(
        weight=one.weight, pose=pose, reason=one.reason, hand=one.hand, containers=one.containers,
        supports=one.supports, worlds=one.worlds,
    )  # fmt: skip


def _rounded(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(value, 5) for value in values)


def _whole(upper: Sequence[float]) -> Array:
    """The covariance of an upper triangle, without the negative eigenvalues that rounding may have made."""
    if len(upper) != len(_UPPER[0]):
        raise ValueError(f"covariance of {len(upper)} numbers; expected {len(_UPPER[0])}")
    matrix = np.zeros((6, 6))
    matrix[_UPPER] = upper
    values, vectors = np.linalg.eigh(matrix + np.triu(matrix, 1).T)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _drawn(pose: Pose | None, random: np.random.Generator) -> Pose | None:
    """A pose drawn by the covariance of its right perturbation; to first order for the rotation."""
    if pose is None or pose.covariance is None:
        return pose
    values, vectors = np.linalg.eigh(np.asarray(pose.covariance))
    shift = vectors @ (np.sqrt(np.maximum(values, 0.0)) * random.standard_normal(6))
    x, y, z, *turn = shift.tolist()
    noise = Pose((x, y, z), quaternions.from_rotvec((turn[0], turn[1], turn[2])), pose.stamp)
    return Pose.unchecked(pose.t, pose.q, pose.stamp) @ noise
