"""All tolerances of the surprise detector in one place."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

from dsr.perception.noise import PerceptNoise
from dsr.vocabulary.nats import MISSED_FRAME, MOST_MISSED

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Count = Annotated[int, msgspec.Meta(ge=1)]


class SurpriseConfig(PerceptNoise, frozen=True, forbid_unknown_fields=True):
    """Limits from which percept and belief disagree, and how long a disagreement must last.

    The defaults are for percepts 10 times a second from an RGB-D camera at 0.3 to 1 m whose depth is off by up to
    15 mm, always alike for one object, and jitters by 3 mm. A disagreement must be beyond a least extent and beyond
    `sigmas`.
    """

    shift: Positive = 0.008
    """m across the viewing ray"""
    turn: Positive = 0.15
    """rad about the vertical"""
    tilt: Positive = 0.30
    """rad about a horizontal axis: perception knows tilt least well"""
    depth_bound: Positive = 0.020
    """m along the viewing ray that the systematic error may be, while it is not known"""
    depth_change: Positive = 0.012
    """m along the viewing ray from the known systematic error"""
    sigmas: Positive = 4.0
    """Standard deviations in the direction of the disagreement."""
    hysteresis: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.7
    """Share of these limits within which percept and belief agree again."""

    needed: Count = 3
    """Percepts that must disagree alike ..."""
    window: Count = 5
    """... of the last so many."""
    held_needed: Count = 2 * needed
    """Percepts that must disagree alike for an object that the gripper holds or has just released."""
    held_window: Count = 8
    """count of its newest percepts that are looked at, while the gripper holds it or has just released it"""
    held_grace: NotNegative = 1.0
    """s after its release that an object counts as held"""
    alike: Annotated[float, msgspec.Meta(ge=-1, le=1)] = math.sqrt(0.5)
    """Least cosine between disagreements that are alike ..."""
    close: Positive = 0.5
    """... and how far apart they may be, in lengths of the greater."""

    learn_after: Count = 10
    """Percepts that agree after which it is known."""
    learn_window: Count = 50
    """Percepts over which it is averaged."""
    unseen_noise: NotNegative = 0.005
    """m, of a belief without covariance: of an object that was never seen where it is believed to be"""
    unseen_rotation_noise: NotNegative = 0.1
    """rad, of a belief without covariance: of an object that was never seen where it is believed to be"""

    all_seen: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.95
    """Share of its tag from which an object should be seen."""
    nothing_seen: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 1.0 - all_seen
    """Share up to which it cannot be seen."""
    unexpected_after: Positive = 0.5
    """s of camera frames that show other things but not what should be seen, or what cannot be"""
    frames: Count = math.ceil(MOST_MISSED / MISSED_FRAME)
    """Least number of these frames: with more, a thing that is missing is no more improbable."""
    silent_after: Positive = 1.5
    """s without any percept from a camera that should see something"""
    camera_speed: Positive = 0.01
    """m/s at which a camera moves: nothing is expected of it then"""
    camera_turn: Positive = 0.025
    """rad/s at which a camera turns: nothing is expected of it then"""

    nats_period: Positive = 0.2
    """s between two looks at how improbable what is seen is"""
    hand_speed: Positive = 0.7
    """m/s, standard deviation of each part of the velocity of a hand"""
    hand_noise: Positive = 0.015
    """m, standard deviation of each coordinate of a percept of a hand"""

    calm_after: NotNegative = unexpected_after
    """s without contradiction, of an object that is not seen any more, after which it is not surprising"""
    fresh: Positive = 1.0
    """s for which a percept counts as new"""
    forget_after: Positive = 5.0
    """s after which a disagreement that was not seen again counts no more"""
    jump: Positive = 0.005
    """m by which a belief changes at once when it was changed on purpose"""
    jump_turn: Positive = 0.1
    """rad by which a belief turns at once when it was changed on purpose"""
    text_period: NotNegative = 0.5
    """s between two changes of the figures in the text"""
