"""Plays recordings: the graph at any time of one, as a running graph, or with some agents run anew."""

from agents.replay.source import ReplayedGraph

__all__ = ["ReplayedGraph"]
