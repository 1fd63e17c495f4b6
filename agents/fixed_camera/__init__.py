"""A camera on a stand: its place in the working memory, and its frames."""

from agents.fixed_camera.agent import FixedCamera

__all__ = ["FixedCamera"]
