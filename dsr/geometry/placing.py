"""Models into a world of the working memory: nodes with meshes, boxes and poses below a node that is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dsr.errors import ConfigError
from dsr.geometry.mesh import MOST_AT_NODE, Bounds
from dsr.geometry.model import Model, ModelNode
from dsr.math3d.transforms import Pose

if TYPE_CHECKING:
    from dsr.memory import Memory

ROOT = "world"
"""The outermost frame, and its type."""
OBJECT, GROUP = "object", "group"
_CENTRED = ("cube", "box", "container", "cup", "ball")  # as `dsr.vocabulary.relations.THINGS`
_ON_TOP = ("table",)


def put_model(
    memory: Memory, model: Model, *, under: str = "world", type: str = OBJECT, prefix: str = "", at: Pose | None = None
) -> list[str]:
    """Add the nodes of a model with their meshes, or update those that are there.

    What has a mesh becomes a node of `type`, what only holds others together a `group`. A thing (cube, cup, ...) or a
    table is one rigid body: the whole model becomes one node, with its frame at the centre of its bounding box, or of
    its top, and its `size`.

    Args:
        memory: the world.
        model: from `load_model`.
        under: name of the node that becomes the parent of the model's root.
        type: node type of what has a mesh.
        prefix: put before all names.
        at: under_from_file; where the file's origin comes to be.

    Returns:
        The names of the nodes, the root first.

    Raises:
        NodeNotFoundError: if there is no node `under`; the root `world` is made if there is none.
        SchemaError: for an unknown type.
        ConfigError: if a name is taken by a node of another type or elsewhere, or a node has too many meshes;
            nothing is written then.
    """
    if under != ROOT:
        memory.node(under)
    memory.schema.check_node(f"{prefix}{model.root.name}", type)
    if type in _CENTRED or type in _ON_TOP:
        model = model.merged((0.5, 0.5, 1.0) if type in _ON_TOP else (0.5, 0.5, 0.5))
    nodes = [_renamed(node, prefix) for node in model.nodes]
    for node in nodes:
        _check_free(memory, node, node.parent or under, type if node.meshes else GROUP)
    for mesh in model.meshes:
        memory.put_mesh(mesh)
    with memory.batch():
        if under not in memory:
            memory.add_node(ROOT, ROOT)
        for node in nodes:
            pose = node.pose if node.parent is not None or at is None else at @ node.pose
            memory.add_node(node.name, type if node.meshes else GROUP, **_attributes(node, type))
            memory.add_edge(node.parent or under, node.name, "RT", pose=pose)
    return [node.name for node in nodes]


def _renamed(node: ModelNode, prefix: str) -> ModelNode:
    return node._replace(name=prefix + node.name, parent=None if node.parent is None else prefix + node.parent)


def _check_free(memory: Memory, node: ModelNode, parent: str, type: str) -> None:
    memory.schema.check_node(node.name, type)
    if len(set(node.meshes)) > MOST_AT_NODE:
        raise ConfigError(f"{node.name!r}: {len(set(node.meshes))} meshes; at most {MOST_AT_NODE} at one node")
    there = memory.get_node(node.name)
    if there is None:
        return
    parents = {edge.src for edge in memory.edges("RT", dst=node.name)}
    if there.type != type or parents - {parent}:
        where = f" under {', '.join(sorted(parents))}" if parents else ""
        raise ConfigError(f"{node.name!r} is there already, a {there.type}{where}; give the model's names a prefix")


def _attributes(node: ModelNode, type: str) -> dict[str, object]:
    bounds = node.bounds
    if bounds is None:
        return {}
    attributes: dict[str, object] = {
        "mesh": ",".join(dict.fromkeys(mesh.hash for mesh in node.meshes)),
        "bounds": (*bounds.low, *bounds.high),
    }
    if type in _CENTRED or type in _ON_TOP:
        attributes["size"] = extent(bounds)
    return attributes


def extent(bounds: Bounds) -> tuple[float, float, float]:
    """Edge lengths of a box, m."""
    x, y, z = (high - low for low, high in zip(bounds.low, bounds.high, strict=True))
    return x, y, z
