"""Finds the poses of cameras from percepts of objects whose places are believed."""

from agents.calibrator.agent import Calibrator
from agents.calibrator.config import CalibratorConfig

__all__ = ["Calibrator", "CalibratorConfig"]
