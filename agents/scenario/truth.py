"""The true world as the plant tells it to judges and recordings."""

from __future__ import annotations

import msgspec

from dsr.math3d.transforms import Pose
from dsr.network.decoding import decoded

_Seven = tuple[float, float, float, float, float, float, float]


class Truth(msgspec.Struct, frozen=True):
    """One instant of the true world."""

    stamp: float
    """s"""
    objects: dict[str, _Seven]
    """By name: position (m) and quaternion (x, y, z, w) in the world frame."""
    held: str | None = None
    """Object in the gripper."""
    moving: frozenset[str] = frozenset()
    """Objects that do not lie still."""
    in_view: frozenset[str] = frozenset()
    """Objects whose tag the camera could see in its last frame."""
    grasped: dict[str, str] = {}
    """Objects that are held, and by what: `gripper`, the node of a hand, or `unknown` for the experimenter."""
    moves: dict[int, tuple[float, float | None]] = {}
    """By the number of an event in the file (from 1): when its move began and ended, s after the start."""
    given_up: dict[int, str] = {}
    """Of those, the ones that could not be carried out, and why."""
    hands: dict[int, tuple[tuple[float, float, float], ...]] = {}
    """21 landmarks (m, world) of each human hand in the scene, by number."""
    camera: dict[str, _Seven] = {}
    """world_from_camera of the scenario's camera, by the plant's name of it."""
    touched: dict[str, str] = {}
    """Objects on which fingertips of a human hand just lie, and the node of the hand."""

    def poses(self) -> dict[str, Pose]:
        """world_from_object of each object."""
        return {name: Pose(seven[:3], seven[3:], self.stamp) for name, seven in self.objects.items()}

    def cameras(self) -> dict[str, Pose]:
        """world_from_camera of each camera, by the name of its node."""
        return {f"camera_{name}": Pose(seven[:3], seven[3:], self.stamp) for name, seven in self.camera.items()}


_decoder = msgspec.msgpack.Decoder(Truth)


def decode_truth(payload: bytes) -> Truth:
    """The truth in a message; raises `WireError`. Fields unknown here are ignored."""
    return decoded(payload, "truth", _read)


def _read(payload: bytes) -> Truth:
    truth = _decoder.decode(payload)
    truth.poses()
    truth.cameras()
    return truth
