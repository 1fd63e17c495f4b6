"""Geometry: meshes as immutable blobs known by their hash, where they come from, and the boxes around things."""

from dsr.geometry.mesh import Bounds, Mesh, mesh_hashes

__all__ = ["Bounds", "Mesh", "mesh_hashes"]
