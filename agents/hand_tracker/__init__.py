"""Sees human hands and tells the working memory where their palms and fingertips are.

`HandTracker` is loaded on first use, so that `dsr hands fetch` needs no library of images.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agents.hand_tracker.config import HandTrackerConfig

if TYPE_CHECKING:
    from agents.hand_tracker.agent import HandTracker

__all__ = ["HandTracker", "HandTrackerConfig"]


def __getattr__(name: str) -> Any:
    if name != "HandTracker":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from agents.hand_tracker.agent import HandTracker

    return HandTracker
