"""Runs the agent for spatial relations as a process."""

from agents.spatial_relations.agent import SpatialRelations
from dsr import main

main(SpatialRelations)
