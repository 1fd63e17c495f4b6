"""The agent that writes which things each person sees: edges `sees`."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from dsr.agent import Access
from dsr.graph.elements import Edge
from dsr.network.keys import BASE
from dsr.visibility import BAND, LEAST_SHARE, PERSON, PERSPECTIVES, WIDTH, VisibilityMonitor
from dsr.worlds import Monitor, WorldsConfig

_NEWS = 0.1  # of a share, that is written again
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class VisibilityConfig(WorldsConfig, frozen=True, forbid_unknown_fields=True):
    """The persons whose edges `sees` are written, and the limits of visibility."""

    kinds: tuple[str, ...] = (PERSON,)
    """Types of perspectives: `person`, `camera`; edges that the simulation handler writes from cameras stay as they
    are."""
    least_share: Share = LEAST_SHARE
    """Least share of a thing's pixels, as it would have alone, from which on it is visible."""
    band: Share = BAND
    """Hysteresis: a visible thing stays visible until its share is below the least by this much."""
    width: Annotated[int, msgspec.Meta(ge=16, le=4096)] = WIDTH
    """px, of the pictures"""

    def __post_init__(self) -> None:
        if not set(self.kinds) <= set(PERSPECTIVES):
            raise ValueError(f"kinds {list(self.kinds)}: expected some of {list(PERSPECTIVES)}")


class Visibility(Monitor):
    """Keeps an edge `sees` from each person to each thing that they see now, with the `share` of it that they see.

    In the base, unless it is configured for another world (`reads`).
    """

    name = "visibility"
    reads: ClassVar[Any] = (BASE,)
    contents = Access(edges=("sees",), attributes=("share", "visible", "hidden_by"))
    rate_hz = 5.0
    reactive = False
    Config = VisibilityConfig
    config: VisibilityConfig

    def opened(self) -> None:
        """Make the monitor."""
        config = self.config
        self._monitor = VisibilityMonitor(
            self.target, least_share=config.least_share, band=config.band, width=config.width, kinds=config.kinds
        )

    def update(self, now: float) -> None:
        """Look, and write what is news."""
        self.changes()
        self._monitor.update()
        seen = self._monitor.seen
        with self.target.batch():
            for edge in self.target.edges("sees"):
                node = self.target.get_node(edge.src)
                is_ours = node is not None and node.type in self.config.kinds and not _is_by_the_simulation(edge)
                if is_ours and (edge.src, edge.dst) not in seen:
                    self.target.remove_edge(edge.src, edge.dst, "sees")
            for name, thing in sorted(seen):
                self._write(name, thing)

    def _write(self, name: str, thing: str) -> None:
        if name not in self.target or thing not in self.target:
            return
        visible = self._monitor.visibilities[name, thing]
        edge = self.target.get_edge(name, thing, "sees")
        if edge is not None and _is_by_the_simulation(edge):
            return
        if (
            edge is None
            or abs(edge.get("share", 0.0) - visible.share) > _NEWS
            or edge.get("hidden_by") != visible.hidden_by
        ):
            self.target.add_edge(name, thing, "sees", share=visible.share, visible=True, hidden_by=visible.hidden_by)


def _is_by_the_simulation(edge: Edge) -> bool:
    """Whether the simulation handler keeps an edge, which says the same, and more of what cameras recognise."""
    return "detectable" in edge
