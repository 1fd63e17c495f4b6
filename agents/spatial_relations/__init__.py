"""Keeps edges of spatial relations (above, left_of, ...) between things for whoever asks for them."""

from agents.spatial_relations.agent import SpatialRelations

__all__ = ["SpatialRelations"]
