"""All that can be configured of the surprise detector in one place."""

from __future__ import annotations

from typing import Annotated

import msgspec

from dsr.perception.noise import NOTHING_SEEN, PerceptNoise
from dsr.perception.scales import AT_REST, FRAME, HAND_SPEED, SAME_OUTCOME, STEADY, SURE_SIGMAS, WINDOW
from dsr.vocabulary.perceived import CAMERA_SPEED, CAMERA_TURN

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Count = Annotated[int, msgspec.Meta(ge=1)]


class SurpriseConfig(PerceptNoise, frozen=True, forbid_unknown_fields=True):
    """Noise and times. What is surprising follows from them and from `SURPRISING` of `dsr.vocabulary.nats`."""

    learn_window: Count = WINDOW
    """count of percepts over which the systematic error of depth is averaged"""
    unseen_noise: NotNegative = SAME_OUTCOME
    """m, of a belief without covariance: of an object that was never seen where it is believed to be. A belief that
    changes by more at once was changed on purpose."""
    unseen_rotation_noise: NotNegative = SURE_SIGMAS * PerceptNoise().tilt_noise
    """rad, of a belief without covariance: of an object that was never seen where it is believed to be. A belief that
    turns by more at once was changed on purpose."""

    nothing_seen: Annotated[float, msgspec.Meta(ge=0, lt=1)] = NOTHING_SEEN
    """1, share of its tag or image up to which an object cannot be seen"""
    pause: Positive = 2.0 * FRAME
    """s, mean of the times for which a camera shows nothing and nothing is wrong"""
    camera_speed: Positive = 0.5 * CAMERA_SPEED
    """m/s at which a camera moves: nothing is expected of it then"""
    camera_turn: Positive = 0.5 * CAMERA_TURN
    """rad/s at which a camera turns: nothing is expected of it then"""

    nats_period: Positive = 2.0 * FRAME
    """s between two looks at where the belief allows things to be, and between two values of `nats` in the graph"""
    hand_speed: Positive = HAND_SPEED
    """m/s, standard deviation of each part of the velocity of a hand"""
    hand_noise: Positive = 0.015
    """m, standard deviation of each coordinate of a percept of a hand"""

    telling: NotNegative = AT_REST
    """s for which what is told stays as it is. That holds for figures in the text, and for the flag of an object of
    which nothing contradicts the belief any more."""
    fresh: Positive = STEADY
    """s for which a percept counts as new, and without one of which evidence begins anew. So long after its
    release an object counts as held: what was seen before is evidence yet."""
