"""Human hands in the true world: their poses, held objects, looks, and the things that they hide.

Hands are kinematic. They have no collision shapes: what they move they hold or push along, which is the stage's doing.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.colors import SKIN, SLEEVE
from agents.plant.bullet import Bullet
from agents.plant.hand_figure import (
    BONES,
    JOINTS,
    PALM_RADIUS,
    TIP_RADIUS,
    Side,
    joints,
    nominal_length,
    radius,
    relaxed,
)
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]
_AROUND = 12
_RINGS = 3  # of each cap


def write_capsule(folder: Path, name: str, length: float, radius: float, color: Vector3) -> Path:
    """Write a capsule about z, `length` m between the centres of its ends; `color` is red, green, blue, 0 to 1."""
    bgr = np.round(np.array(color[::-1]) * 255).astype(np.uint8)
    cv2.imwrite(str(folder / f"{name}.png"), np.full((8, 8, 3), bgr, np.uint8))
    material = f"newmtl skin\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {name}.png\n"
    (folder / f"{name}.mtl").write_text(material, encoding="utf-8")
    file = folder / f"{name}.obj"
    file.write_text(_geometry(name, length, radius), encoding="utf-8")
    return file


def capsule_pose(start: Array, end: Array) -> Pose:
    """The pose of a capsule whose ends are centred at points (3,)."""
    along = end - start
    distance = float(np.linalg.norm(along))
    x, y, z = (float(part) for part in (along / distance if distance > 0.0 else (0.0, 0.0, 1.0)))
    angle = math.acos(max(-1.0, min(1.0, z)))
    norm = math.hypot(x, y)
    axis = (-y / norm * angle, x / norm * angle, 0.0) if norm > 1e-9 else (angle, 0.0, 0.0)
    return Pose(0.5 * (start + end), quaternions.from_rotvec(axis))


def blocked(eye: Array, targets: Array, starts: Array, ends: Array, radii: Array) -> NDArray[np.bool_]:
    """(n, m) whether the view from `eye` (3,) to targets (n, 3) passes through capsules (m,)."""
    nearest = _nearest(eye, targets, starts, ends)
    return np.asarray(nearest < radii)


def _nearest(eye: Array, targets: Array, starts: Array, ends: Array) -> Array:
    """(n, m) least distances between the segments from the eye to targets and those from starts to ends.

    Ericson, Real-Time Collision Detection, 5.1.9, for segments that are not points.
    """
    d1, d2, r = (targets - eye)[:, None], (ends - starts)[None], (eye - starts)[None]
    a, e = (d1 * d1).sum(-1), (d2 * d2).sum(-1)
    b, c, f = (d1 * d2).sum(-1), (d1 * r).sum(-1), (d2 * r).sum(-1)
    denominator = a * e - b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(denominator > 1e-12, np.clip((b * f - c * e) / denominator, 0.0, 1.0), 0.0)
        t = np.clip((b * s + f) / e, 0.0, 1.0)
        s = np.clip((b * t - c) / a, 0.0, 1.0)
    first, second = eye + s[..., None] * d1, starts + t[..., None] * d2
    return np.asarray(np.linalg.norm(first - second, axis=-1))


def _geometry(name: str, length: float, radius: float) -> str:
    quarter = np.linspace(0.0, math.pi / 2, _RINGS + 1)
    latitudes = [*((angle, length / 2) for angle in quarter[::-1]), *((-angle, -length / 2) for angle in quarter)]
    normals = [
        (math.cos(angle) * math.cos(turn), math.cos(angle) * math.sin(turn), math.sin(angle))
        for angle, _ in latitudes
        for turn in np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    ]
    heights = np.repeat([height for _, height in latitudes], _AROUND)
    vertices = [(x * radius, y * radius, z * radius + up) for (x, y, z), up in zip(normals, heights, strict=True)]
    lines = [f"mtllib {name}.mtl"]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*vertex) for vertex in vertices]
    lines += ["vt 0.5 0.5", *("vn {:.6f} {:.6f} {:.6f}".format(*normal) for normal in normals), "usemtl skin"]
    for ring in range(len(latitudes) - 1):
        for k in range(_AROUND):
            a, b = ring * _AROUND + k + 1, ring * _AROUND + (k + 1) % _AROUND + 1
            c, d = a + _AROUND, b + _AROUND
            lines += [_triangle(a, c, d), _triangle(a, d, b)]
    return "\n".join([*lines, ""])


def _triangle(*corners: int) -> str:
    return "f " + " ".join(f"{corner}/1/{corner}" for corner in corners)


Style = Literal["pinch", "touch"]

_SLEEVE_LENGTH, _SLEEVE_RADIUS = 0.22, 0.028
_SLEEVE_GAP = 0.02  # m, of bare wrist
_WRIST_WIDTH, _WRIST_RADIUS = 0.026, 0.015  # m, of a piece across the wrist
_SLEEVE_RISE = 0.5  # of the palm's slope: the wrist is bent
_STRETCHING = tuple(bone for bone in BONES if 0 < bone[0] < 12)
"""Bones of fingers that touch things: where these are out of reach, two pieces slide along each other."""
_NOWHERE = Pose((0.0, 0.0, -50.0))
_RADII = np.array([radius(bone) for bone in BONES])
_STARTS, _ENDS = (np.array([bone[end] for bone in BONES]) for end in (0, 1))


class SimulatedHand:
    """One hand.

    Args:
        number: as in scenario files; 0 is a right hand, 1 a left one.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.name = f"human_hand_{number}"
        """As judges know it: that of its node, if the tracker numbers hands alike."""
        self.side: Side = "left" if number else "right"
        self.is_present = False
        """In the scene at all."""
        self.from_side = (1.0, 0.0)
        """Along world x and y: where its arm comes from."""
        self.pose = _NOWHERE
        """world_from_palm"""
        self.tips: Array = relaxed(self.side)
        """(5, 3) m, in the palm's frame"""
        self.held: str | None = None
        """The object that it grasps or touches."""
        self.style: Style = "pinch"
        self._held_at = Pose.identity()

    @property
    def landmarks(self) -> Array:
        """(21, 3) joints in the world, m (see hand_figure.py)."""
        return self.pose.apply(joints(self.tips, self.side))

    def hold(self, name: str, world_from_object: Pose, style: Style) -> None:
        """Keep the present place relative to an object."""
        self.held, self.style = name, style
        self._held_at = world_from_object.inverse() @ self.pose

    def follow(self, world_from_object: Pose) -> None:
        """Go with the object that it holds."""
        self.pose = world_from_object @ self._held_at

    def let_go(self) -> None:
        """Hold nothing; harmless when it does not."""
        self.held = None

    def leave(self) -> None:
        """Be gone at once."""
        self.let_go()
        self.is_present = False
        self.pose, self.tips = _NOWHERE, relaxed(self.side)


class Hands:
    """All hands of a scenario, with their bodies in the physics client.

    Args:
        bullet: the physics client.
        numbers: of the hands that there can be.
        seen: bodies are needed, because there are images.
    """

    def __init__(self, bullet: Bullet, numbers: Iterable[int], *, seen: bool) -> None:
        self._bullet = bullet
        self._hands = {number: SimulatedHand(number) for number in sorted(set(numbers))}
        self._bodies = {number: self._make_bodies() for number in self._hands} if seen else {}

    def __getitem__(self, number: int) -> SimulatedHand:
        return self._hands[number]

    @property
    def present(self) -> list[SimulatedHand]:
        """The hands in the scene, by number."""
        return [hand for hand in self._hands.values() if hand.is_present]

    def holding(self, style: Style) -> Mapping[str, str]:
        """Name of the hand by the object that it grasps (`pinch`) or just touches."""
        return {hand.held: hand.name for hand in self.present if hand.held and hand.style == style}

    def draw(self) -> None:
        """Put the bodies where the hands are, for a picture."""
        for number, bodies in self._bodies.items():
            hand = self._hands[number]
            poses = _poses(hand) if hand.is_present else [_NOWHERE] * len(bodies)
            for body, pose in zip(bodies, poses, strict=True):
                self._bullet.set_pose(body, pose)

    def hide(self, eye: Array, targets: Array) -> NDArray[np.bool_]:
        """(n,) whether a hand is between the eye (3,) and points (n, 3) in the world."""
        hidden = np.zeros(len(targets), bool)
        for hand in self.present:
            points = hand.landmarks
            hidden |= blocked(eye, targets, points[_STARTS], points[_ENDS], _RADII).any(axis=1)
            wrist, elbow = _forearm(hand, points)
            hidden |= blocked(eye, targets, wrist[None], elbow[None], np.array([_SLEEVE_RADIUS]))[:, 0]
        return hidden

    def hide_landmarks(self, eye: Array, hand: SimulatedHand) -> NDArray[np.bool_]:
        """(21,) whether flesh or sleeves are between the eye and a hand's landmarks, but for what is around them."""
        points = hand.landmarks
        surface = points + TIP_RADIUS * _unit(eye - points)
        hidden = np.zeros(JOINTS, bool)
        for other in self.present:
            joints_there = other.landmarks
            through = blocked(eye, surface, joints_there[_STARTS], joints_there[_ENDS], _RADII)
            if other is hand:
                through &= ~_OWN
            wrist, elbow = _forearm(other, joints_there)
            sleeve = blocked(eye, surface, wrist[None], elbow[None], np.array([_SLEEVE_RADIUS]))[:, 0]
            hidden |= through.any(axis=1) | sleeve
        return hidden

    def _make_bodies(self) -> list[int]:
        with tempfile.TemporaryDirectory(prefix="dsr-hand-") as folder:  # the physics engine keeps what it read
            pieces = [(nominal_length(bone), radius(bone), SKIN) for bone in (*BONES, *_STRETCHING)]
            pieces += [(_WRIST_WIDTH, _WRIST_RADIUS, SKIN), (_SLEEVE_LENGTH, _SLEEVE_RADIUS, SLEEVE)]
            return [self._make_body(Path(folder), f"piece_{k}", *piece) for k, piece in enumerate(pieces)]

    def _make_body(
        self, folder: Path, name: str, length: float, thickness: float, color: tuple[float, float, float]
    ) -> int:
        file = write_capsule(folder, name, length, thickness, color)
        visual = self._bullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(file))
        body: int = self._bullet.createMultiBody(0, -1, visual, _NOWHERE.t, _NOWHERE.q)
        return body


def _own_pieces() -> NDArray[np.bool_]:
    """(21, m) which pieces of its own hand do not count as hiding a joint: its finger, its palm."""
    own = np.zeros((JOINTS, len(BONES)), bool)
    for joint in range(JOINTS):
        for k, (start, end) in enumerate(BONES):
            same_finger = joint > 0 and (end - 1) // 4 == (joint - 1) // 4
            own[joint, k] = same_finger or joint in (start, end) or (joint in (0, 1, 5, 9, 13, 17) and start == 0)
    return own


_OWN = _own_pieces()


def _poses(hand: SimulatedHand) -> list[Pose]:
    points = hand.landmarks
    across = hand.pose.rotation_matrix[:, 1] * (_WRIST_WIDTH / 2)
    wrist, forearm = (points[0] - across, points[0] + across), _forearm(hand, points)
    first = [_piece_pose(points[a], points[b], nominal_length((a, b))) for a, b in BONES]
    second = [_piece_pose(points[b], points[a], nominal_length((a, b))) for a, b in _STRETCHING]
    return [*first, *second, capsule_pose(*wrist), capsule_pose(*forearm)]


def _piece_pose(near: Array, far: Array, length: float) -> Pose:
    """Of a piece of fixed length that begins at `near` (3,)."""
    return capsule_pose(near, near + length * _unit(far - near))


def _forearm(hand: SimulatedHand, points: Array) -> tuple[Array, Array]:
    """Centres (3,) of its ends: near the wrist, and towards the elbow."""
    back = -hand.pose.rotation_matrix[:, 0] * (1.0, 1.0, _SLEEVE_RISE)
    back /= max(float(np.linalg.norm(back)), 1e-9)
    wrist = points[0] + back * (_SLEEVE_RADIUS + _SLEEVE_GAP - PALM_RADIUS)
    return wrist, wrist + back * _SLEEVE_LENGTH


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
