"""Configuration of the inference of actions."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from dsr.config.plugins import ACTION_POLICIES, checked_name
from dsr.perception.scales import ONE_MOMENT

_Positive = Annotated[float, Meta(gt=0.0)]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class ActionInferenceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Configuration of the agent `action_inference`."""

    policy: str = "attributed"
    """Name of the method that infers: ours, or one that a package provides."""
    parameters: dict[str, float] = {}
    """Parameters of a method that a package provides, by name."""

    lifted: _Positive = 0.015
    """m that a thing must be seen, or believed while it is held, above where it lay, before it has been picked.

    So far below where it was let go, it has been released rather than placed. Twice as far is no matter of two errors.
    """
    lifted_frames: Annotated[int, Meta(ge=1)] = 2
    """Percepts in a row that must show it: a single one may be wrong."""
    steady: _Positive = 0.008
    """m within which percepts of a resting thing stay"""
    settle: _Positive = ONE_MOMENT
    """s for which a thing must rest on something, untouched, before it has been placed"""
    reach: _Positive = 0.1
    """m between a hand and the surface of a thing up to which the hand may have done it, if no edge `grasping` tells"""

    def __post_init__(self) -> None:
        checked_name(ACTION_POLICIES, self.policy, ("attributed",))
