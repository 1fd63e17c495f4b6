"""Human hands in the true world: their poses, held objects, looks, and the things that they hide.

Hands are kinematic. They have no collision shapes: what they move they hold or push along, which is the stage's doing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from agents.plant.bullet import Bullet
from agents.plant.hand_body import NOWHERE, SLEEVE_LENGTH, SLEEVE_RADIUS, HandBody
from agents.plant.hand_figure import (
    BONES,
    JOINTS,
    PALM_RADIUS,
    TIP_RADIUS,
    Side,
    joints,
    radius,
    relaxed,
)
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]


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


Style = Literal["pinch", "touch"]

_SLEEVE_GAP = 0.02  # m, of bare wrist
_SLEEVE_RISE = 0.5  # of the palm's slope: the wrist is bent
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
        self.pose = NOWHERE
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
        self.pose, self.tips = NOWHERE, relaxed(self.side)


class Hands:
    """All hands of a scenario, with their bodies in the physics client.

    Args:
        bullet: the physics client.
        numbers: of the hands that there can be.
        seen: bodies are needed, because there are images.
    """

    def __init__(self, bullet: Bullet, numbers: Iterable[int], *, seen: bool) -> None:
        self._hands = {number: SimulatedHand(number) for number in sorted(set(numbers))}
        self._bodies = {number: HandBody(bullet, hand.side) for number, hand in self._hands.items()} if seen else {}

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
        for number, body in self._bodies.items():
            hand = self._hands[number]
            if hand.is_present:
                body.put(hand.pose, hand.tips, _forearm(hand, hand.landmarks))
            else:
                body.hide()

    def hide(self, eye: Array, targets: Array) -> NDArray[np.bool_]:
        """(n,) whether a hand is between the eye (3,) and points (n, 3) in the world."""
        hidden = np.zeros(len(targets), bool)
        for hand in self.present:
            points = hand.landmarks
            hidden |= blocked(eye, targets, points[_STARTS], points[_ENDS], _RADII).any(axis=1)
            wrist, elbow = _forearm(hand, points)
            hidden |= blocked(eye, targets, wrist[None], elbow[None], np.array([SLEEVE_RADIUS]))[:, 0]
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
            sleeve = blocked(eye, surface, wrist[None], elbow[None], np.array([SLEEVE_RADIUS]))[:, 0]
            hidden |= through.any(axis=1) | sleeve
        return hidden


def _own_pieces() -> NDArray[np.bool_]:
    """(21, m) which pieces of its own hand do not count as hiding a joint: its finger, its palm."""
    own = np.zeros((JOINTS, len(BONES)), bool)
    for joint in range(JOINTS):
        for k, (start, end) in enumerate(BONES):
            same_finger = joint > 0 and (end - 1) // 4 == (joint - 1) // 4
            own[joint, k] = same_finger or joint in (start, end) or (joint in (0, 1, 5, 9, 13, 17) and start == 0)
    return own


_OWN = _own_pieces()


def _forearm(hand: SimulatedHand, points: Array) -> tuple[Array, Array]:
    """Centres (3,) of its ends: near the wrist, and towards the elbow."""
    back = -hand.pose.rotation_matrix[:, 0] * (1.0, 1.0, _SLEEVE_RISE)
    back /= max(float(np.linalg.norm(back)), 1e-9)
    wrist = points[0] + back * (SLEEVE_RADIUS + _SLEEVE_GAP - PALM_RADIUS)
    return wrist, wrist + back * SLEEVE_LENGTH


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
