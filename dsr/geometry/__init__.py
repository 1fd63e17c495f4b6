"""Geometry: meshes as immutable blobs known by their hash, models from files, and the boxes around things."""

from dsr.geometry.boxes import bounding_box, own_bounds, volume
from dsr.geometry.files import load_model
from dsr.geometry.mesh import Bounds, Mesh, mesh_hashes
from dsr.geometry.model import Model, ModelNode
from dsr.geometry.placing import put_model

__all__ = [
    "Bounds",
    "Mesh",
    "Model",
    "ModelNode",
    "bounding_box",
    "load_model",
    "mesh_hashes",
    "own_bounds",
    "put_model",
    "volume",
]
