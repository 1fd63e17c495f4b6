"""Edges of spatial relations in worlds other than the base."""

from __future__ import annotations

from agents.spatial_relations.agent import SpatialRelations
from dsr import main
from dsr.worlds.hosting import Hosted


class RelationsMonitor(Hosted):
    """Keeps edges of spatial relations (see `SpatialRelations`) in a world, or with `writes` in an overlay of it."""

    name = "relations_monitor"
    reads = ("stable",)
    hosts = SpatialRelations


if __name__ == "__main__":
    main(RelationsMonitor)
