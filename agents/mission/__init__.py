"""Gives the robot something to do: writes one intention into the working memory."""

from agents.mission.agent import Mission

__all__ = ["Mission"]
