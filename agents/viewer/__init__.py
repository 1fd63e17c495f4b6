"""Shows the graph, the scene and the agents in rerun, live and as a recording."""

from agents.viewer.agent import Viewer, ViewerConfig

__all__ = ["Viewer", "ViewerConfig"]
