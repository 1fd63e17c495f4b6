"""The viewer of a world other than the base: of a person, a filter, or a plan."""

from __future__ import annotations

from agents.viewer.agent import Viewer
from dsr import main
from dsr.worlds.hosting import Hosted


class WorldViewer(Hosted):
    """Shows the world that its configuration names, as `Viewer` shows the base.

    python -m agents.viewer.in_world --config '{"reads": ["view_of_human_1"], "agent": {"folder": "runs/human_1"}}'
    """

    name = "world_viewer"
    hosts = Viewer


if __name__ == "__main__":
    main(WorldViewer)
