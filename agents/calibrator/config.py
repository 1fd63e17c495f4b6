"""Configuration of calibrations."""

from __future__ import annotations

import math

import msgspec

from dsr.math3d.tolerance import PoseTolerance
from dsr.vocabulary.calibration import DEFAULT_METHOD, checked_method


class CalibratorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How views are collected, and when a camera is in doubt."""

    span: float = 1.0
    """s that the camera looks from each pose"""
    patience: float = 10.0
    """s without anything to see after which a request is refused"""
    views_patience: float = 120.0
    """s that the arm may take to bring the camera to all the views wanted; then those there are must do"""
    new_view: PoseTolerance = PoseTolerance(0.005, 0.02)
    """m, rad that the camera's parent moves between two views"""
    belief_drift: PoseTolerance = PoseTolerance(0.002, 0.02)
    """m, rad that the belief of an object may change within a view; of more, it says nothing"""
    depth_bias: float = 0.01
    """m, systematic error along viewing rays in the percepts' covariances (`depth_bias_std` of the scene estimator)"""
    depth_scatter: float = 0.006
    """m, what counts instead of it: by how much it differs between objects, which hides how the camera is tilted"""
    keep: float = 600.0
    """s after which an answered request is removed"""
    method: str = DEFAULT_METHOD
    """by which a camera in doubt is calibrated, one of `dsr.vocabulary.calibration.method_names()`"""
    by_itself: bool = True
    """Look into it when all that is seen seems displaced alike."""
    lookback: float = 1.5
    """s before that was explained so, from which beliefs are taken: they may be led astray since"""
    elsewhere_patience: float = 30.0
    """s that the arm may take until one of its poses tells a moved camera from objects that were all moved alike"""
    moves_arm: bool = True
    """Ask the arm that carries a camera in doubt for views from elsewhere, where one view does not tell."""
    gripper_from_tool: tuple[float, float, float] = (0.0, 0.0, 0.12)
    """m, the tool point in the frame of the gripper's node"""
    confirmed_for: float = 5.0
    """s after which it is no longer taken for sure that a camera has not moved"""

    def __post_init__(self) -> None:
        checked_method(self.method)
        for name in (
            *("span", "patience", "views_patience", "depth_bias", "depth_scatter", "keep"),
            *("lookback", "elsewhere_patience", "confirmed_for"),
        ):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"{name} {getattr(self, name)}: expected 0 or more")
