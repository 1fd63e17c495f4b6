"""Configuration of the inference of actions."""

from __future__ import annotations

import msgspec

from dsr.config.plugins import ACTION_POLICIES, checked_name


class ActionInferenceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Configuration of the agent `action_inference`."""

    policy: str = "believed"
    """Name of the method that infers: ours, or one that a package provides."""
    parameters: dict[str, float] = {}
    """Parameters of a method that a package provides, by name."""

    def __post_init__(self) -> None:
        checked_name(ACTION_POLICIES, self.policy, ("believed",))
