"""Chooses the model's file and the program that runs it, as the tracker's configuration says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.model.files import ModelFiles, fetched_file, read_fetched, read_model
from agents.hand_tracker.model.found import Landmarker
from agents.hand_tracker.model.litert import LiteRtLandmarker
from agents.hand_tracker.model.tasks import TasksLandmarker


def wants_model(config: HandTrackerConfig) -> bool:
    """Whether hands are to be found by the model, rather than by their colour."""
    if config.finder == "auto":
        return bool(config.model) or fetched_file().exists()
    return config.finder == "model"


def configured_model(config: HandTrackerConfig) -> ModelFiles:
    """The model that is named, else the fetched one. Raises `ConfigError` if it is not there or not whole."""
    return read_model(Path(config.model)) if config.model else read_fetched()


def load_landmarker(config: HandTrackerConfig) -> Callable[[], Landmarker]:
    """What makes a landmarker of the configured model for a camera; either may raise `ConfigError`."""
    files = configured_model(config)
    if config.runner == "mediapipe":
        return lambda: TasksLandmarker(Path(files.where), config.least_score)
    return lambda: LiteRtLandmarker(files, config.least_score)
