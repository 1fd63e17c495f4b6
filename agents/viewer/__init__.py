"""Shows the graph, the scene and the agents in rerun, live and as a recording."""

from agents.viewer.agent import Viewer
from agents.viewer.config import ViewerConfig

__all__ = ["Viewer", "ViewerConfig"]
