"""Sees human hands and tells the working memory where their palms and fingertips are."""

from agents.hand_tracker.agent import HandTracker
from agents.hand_tracker.config import HandTrackerConfig

__all__ = ["HandTracker", "HandTrackerConfig"]
