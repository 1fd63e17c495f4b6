"""Puts the known furniture and objects of a scene into the working memory, once."""

from agents.scene_setup.agent import SceneSetup

__all__ = ["SceneSetup"]
