"""Sees AprilTags and tells the working memory where the objects are, from the camera."""

from agents.scene_estimator.agent import SceneEstimator
from agents.scene_estimator.config import SceneEstimatorConfig

__all__ = ["SceneEstimator", "SceneEstimatorConfig"]
