"""Worlds with containers: what is moved, along ways with noise, and what nobody sees any more."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose, interpolate
from simulation_handler.belief import Belief
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining import VisibilityQuery
from simulation_handler.hands.state import HandPercept
from simulation_handler.perception.percepts import SeenObject
from tests.simulation_handler.worlds import BALL, CAMERA, CUBE, PERIOD, ROUND, TABLE, beaker, container

BOX: Vector3 = (0.17, 0.17, 0.15)
SMALL: Vector3 = (0.09, 0.09, 0.08)
FLAT: Vector3 = (0.2, 0.2, 0.04)
BOARD: Vector3 = (0.03, 0.5, 0.05)


class Thing(NamedTuple):
    """What an object is."""

    size: Vector3
    shape: Shape = ()
    mass: float = 0.05
    rolling_friction: float | None = None


KINDS = {
    "cube": Thing(CUBE),
    "ball": Thing(BALL, ROUND),
    "pearl": Thing(BALL, ROUND, rolling_friction=0.002),
    "marble": Thing((0.04, 0.04, 0.04), (ROUND[0]._replace(size=(0.04, 0.04, 0.04)),)),
    "box": Thing(BOX, container(BOX), 0.2),
    "other": Thing(BOX, container(BOX), 0.2),
    "cover": Thing(BOX, container(BOX, upside_down=True), 0.2),
    "tray": Thing(FLAT, container(FLAT), 0.2),
    "cup": Thing(SMALL, container(SMALL), 0.1),
    "beaker": Thing(SMALL, beaker(SMALL), 0.1),
    "block": Thing((0.2, 0.3, 0.25), (), 0.5),
    "board": Thing(BOARD, (), 0.3),
}
"""By the first part of their names."""
NOISE = 0.002
"""m of each coordinate of a percept"""


class Occlusion:
    """Percepts at 10 Hz of true poses that only tests move, and a belief at 20 Hz.

    Args:
        truths: world_from_object by name, such as `box_1`; all are seen at first.
        noise: m, standard deviation of each coordinate of a percept.

    The palm is seen turned by `palm_askew`, as one that is hidden in part may be.
    """

    def __init__(self, truths: dict[str, Pose], seed: int = 0, noise: float = NOISE) -> None:
        self.truths = dict(truths)
        self.seen = set(truths)
        self.rng = np.random.default_rng(seed)
        self.noise = noise
        self.visibility: VisibilityQuery | None = None
        self.held = ""
        self.palm: Pose | None = None
        self.palm_askew = Pose.identity()
        self.hand_seen = True
        self.hand_noise = 0.003
        self.last_hand: HandPercept | None = None
        self.hand_from_object = Pose.identity()
        self.tips_from_object: dict[str, Vector3] = {}
        self.belief = Belief(BeliefConfig())
        self.belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)))
        self.now, self.ticks = 1000.0, 0
        for name in truths:
            kind = KINDS[name.split("_")[0]]
            self.belief.add_object(name, **kind._asdict())

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            self.tick()

    def tick(self) -> None:
        """One step of the belief, with new percepts at every other one."""
        self.now += PERIOD
        self.ticks += 1
        if self.ticks % 2:
            for name in sorted(self.seen):
                self.belief.observe([SeenObject(name, self.percept(name), self.now, CAMERA)])
            self.see_hand()
        self.belief.flag(self.belief.names)
        self.belief.set_visibility(self.visibility)
        self.belief.step(self.now)

    def hand(self, name: str, opened: float = 0.0, tips: str = "pinch") -> None:
        """A hand at an object: thumb and index on opposite sides (pinch), or two fingers on one (touch)."""
        half = 0.5 * KINDS[name.split("_", maxsplit=1)[0]].size[1] + 0.008 + opened
        places = {
            "pinch": ((0.0, half, 0.02), (0.0, -half, 0.02)),
            "touch": ((-0.011, half, 0.02), (0.011, half, 0.02)),
        }
        self.held = name
        self.hand_from_object = Pose((0.1, 0.0, -0.05), (0.0, 0.0, 0.0, 1.0))
        self.tips_from_object = {f"hand_finger_{k}": place for k, place in enumerate(places[tips])}
        self.place_hand()

    def place_hand(self) -> None:
        """Let the hand be where it holds the object."""
        self.palm = self.truths[self.held] @ self.hand_from_object.inverse()

    def see_hand(self) -> None:
        """Let the belief see the hand, with noise, or know that it does not."""
        if self.palm is None:
            return
        if self.hand_seen:
            stamped = self.noisy(self.palm @ self.palm_askew)
            object_from_hand = self.hand_from_object.inverse()
            tips = {}
            for name, place in self.tips_from_object.items():
                local = object_from_hand.inverse() @ Pose(place, (0.0, 0.0, 0.0, 1.0))
                tips[name] = self.noisy(self.palm @ local)
            self.last_hand = HandPercept(stamped, tips, True)
        elif self.last_hand is not None:
            self.last_hand = self.last_hand._replace(perceived=False)
        self.belief.touch({} if self.last_hand is None else {"hand": self.last_hand})

    def noisy(self, pose: Pose) -> Pose:
        """A landmark as the hand tracker has it."""
        x, y, z = np.array(pose.t) + self.hand_noise * self.rng.normal(size=3)
        return Pose((x, y, z), pose.q, self.now)

    def percept(self, name: str) -> Pose:
        """Where an object is seen."""
        truth = self.truths[name]
        turn = Pose.from_rotvec((0.0, 0.0, 0.0), self.rng.normal(size=3) * (0.01, 0.01, 0.01))
        shift = self.noise * self.rng.normal(size=3)
        x, y, z = np.array(truth.t) + shift
        return Pose((x, y, z), (Pose((0, 0, 0), truth.q) @ turn).q, self.now)

    def move(self, name: str, to: Pose, speed: float = 0.15, turning: float = 1.0) -> None:
        """Let an object truly move in a straight line (m/s, and at most `turning` rad/s), while time passes."""
        begin = self.truths[name].with_stamp(0.0)
        metres, radians = begin.distance(to)
        seconds = max(metres / speed, radians / turning)
        for k in range(1, math.ceil(seconds / PERIOD) + 1):
            self.truths[name] = interpolate(begin, to.with_stamp(seconds), min(k * PERIOD, seconds))
            if name == self.held:
                self.place_hand()
            self.tick()

    def pose(self, name: str) -> Pose:
        """Where an object is believed to be."""
        pose = self.belief.pose(name)
        assert pose is not None
        return pose

    def error(self, name: str) -> float:
        """Distance of the belief from the truth, m."""
        return self.pose(name).distance(self.truths[name])[0]

    def texts(self) -> list[str]:
        """What was explained since the last call."""
        return [explanation.text for _, explanation in self.belief.explanations()]


def standing(x: float, y: float, size: Vector3, on: float = 0.0, yaw: float = 0.0) -> Pose:
    """Pose of an upright object whose bottom is at height `on` m."""
    return Pose.from_rotvec((x, y, on + 0.5 * size[2]), (0.0, 0.0, yaw))
