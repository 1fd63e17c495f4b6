"""Geometry without a graph: rotations, rigid transforms, polygons, shapes and their surfaces."""
