"""What can be configured of the inference of actions."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

_Positive = Annotated[float, Meta(gt=0.0)]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class PublishedMachine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the published state machine."""

    threshold: _Share = 0.85
    """Confidence beyond which an action is inferred."""
    gain: _Positive = 1.85
    """By which a confidence is multiplied at each update at which the condition of its action holds."""
    loss: _Share = 0.15
    """Likewise, when it does not hold."""
    floor: _Share = 0.1
    """Least confidence."""


class ActionInferenceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Configuration of the agent `action_inference`."""

    policy: Literal["attributed", "published"] = "attributed"
    """Which method infers: ours, or the state machine of Sallami et al."""
    published: PublishedMachine = PublishedMachine()

    lifted: _Positive = 0.015
    """m that a thing must be seen, or believed while it is held, above where it lay, before it has been picked"""
    lifted_frames: Annotated[int, Meta(ge=1)] = 2
    """Percepts in a row that must show it: a single one may be wrong."""
    steady: _Positive = 0.008
    """m within which percepts of a thing that lies still stay"""
    fallen: _Positive = 0.02
    """m that a thing must have come down since it was let go to have been released rather than placed"""
    settle: _Positive = 0.15
    """s for which a thing must rest on something, untouched, before it has been placed"""
    reach: _Positive = 0.1
    """m between a hand and the surface of a thing up to which the hand may have done it, if no edge `grasping` tells"""
