"""What can be configured about calibrations."""

from __future__ import annotations

import math

import msgspec


class CalibratorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How views are collected."""

    span: float = 1.0
    """s that the camera looks from each pose"""
    patience: float = 10.0
    """s without anything to see after which a request is refused"""
    views_patience: float = 120.0
    """s that the arm may take to bring the camera to all the views wanted; then those there are must do"""
    new_view: tuple[float, float] = (0.005, 0.02)
    """m, rad that the camera's parent moves between two views"""
    belief_drift: tuple[float, float] = (0.002, 0.02)
    """m, rad that the belief of an object may change within a view; of more, it says nothing"""
    depth_bias: float = 0.01
    """m, systematic error along viewing rays in the percepts' covariances (`depth_bias_std` of the scene estimator)"""
    depth_scatter: float = 0.006
    """m, what counts instead of it: by how much it differs between objects, which hides how the camera is tilted"""
    keep: float = 600.0
    """s after which an answered request is removed"""

    def __post_init__(self) -> None:
        for name in ("span", "patience", "views_patience", "depth_bias", "depth_scatter", "keep"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"{name} {getattr(self, name)}: expected 0 or more")
