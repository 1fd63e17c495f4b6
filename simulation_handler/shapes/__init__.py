"""Shapes of bodies: solids, their faces and surfaces, and convex parts of meshes."""
