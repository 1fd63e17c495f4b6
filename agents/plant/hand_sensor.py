"""A sensor that tells hand landmarks instead of images: the truth with the errors that a landmark detector has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.drivers import HandReading, HandReadings
from agents.plant.camera import SimulatedCamera
from agents.plant.hand_figure import JOINTS, PALM, TIP_RADIUS
from agents.plant.hands import Hands, SimulatedHand
from agents.plant.world import World

Array = NDArray[np.float64]

SIGMA = 0.003
"""m, standard deviation of each coordinate of a landmark"""
LEAST_SEEN = 8
"""Landmarks in view with which a hand is found."""
_REACHED = 0.999  # share of a ray without obstacle that counts as reaching the landmark


def read_hands(
    camera: SimulatedCamera, world: World, hands: Hands, rng: np.random.Generator, stamp: float
) -> HandReadings:
    """Simulate the hands that `camera` sees now; errors are drawn also for hands that it does not see."""
    readings = []
    camera_from_world = camera.pose.inverse()
    for hand in hands.present:
        noise = rng.normal(0.0, SIGMA, (JOINTS, 3))
        seen = landmarks_in_view(camera, world, hands, hand)
        if not camera.covers and seen.sum() >= LEAST_SEEN and seen[list(PALM)].any():
            points = np.where(seen[:, None], camera_from_world.apply(hand.landmarks) + noise, 0.0)
            landmarks = tuple((float(x), float(y), float(z)) for x, y, z in points)
            readings.append(HandReading(hand.side, landmarks, tuple(map(bool, seen)), SIGMA))
    return HandReadings(stamp, readings, camera.intrinsics)


def landmarks_in_view(camera: SimulatedCamera, world: World, hands: Hands, hand: SimulatedHand) -> NDArray[np.bool_]:
    """(21,) which landmarks are in the image with nothing in front of them but the flesh around them."""
    eye, points = camera.pose.translation, hand.landmarks
    local = camera.pose.inverse().apply(points)
    intrinsics = camera.intrinsics
    pixels = intrinsics.project(np.column_stack([local[:, :2], np.maximum(local[:, 2], 1e-6)]))
    inside = (
        (local[:, 2] > 0)
        & (pixels >= 0).all(axis=1)
        & (pixels <= (intrinsics.width - 1, intrinsics.height - 1)).all(axis=1)
    )
    surface = points + TIP_RADIUS * (eye - points) / np.linalg.norm(eye - points, axis=1, keepdims=True)
    hits = world.bullet.rayTestBatch([eye.tolist()] * len(surface), surface.tolist())
    free = np.array([hit[0] < 0 or hit[2] > _REACHED for hit in hits])
    return np.asarray(inside & free & ~hands.hide_landmarks(eye, hand))
