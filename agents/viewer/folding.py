"""Which part of the working memory the graph view draws: parts of arms and hands, and finished actions, are folded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from agents.viewer.routing import EdgeKey
from agents.viewer.texts import drawable
from dsr import Edge, Memory, Node
from dsr.frames.tree import WORLD
from dsr.graph.schema import SCHEMA_RECORD
from dsr.graph.shares import shared_out
from dsr.timeline import EVENT, SITUATION, SUMMARY, TIMELINE
from dsr.vocabulary.intentions import ENDED

MOST_NODES = 1000
"""Nodes that are drawn: more have no room in a picture, and whoever may write could make any number"""
MOST_EDGES = 4 * MOST_NODES
"""Edges likewise: each node of a scene has some four"""
_LEFT_OUT = (EVENT, SITUATION, SUMMARY, SCHEMA_RECORD)
"""Types of nodes that are not drawn: too many, and shown elsewhere."""
_IMAGES_SHOW = "sees"
"""Type of edges that are not drawn: the images show the same."""
_WHOLES = {"body": "arm", "finger": "hand", "action": "intention"}
"""Type of the node into which nodes of a type are folded. Of the actions, those that are over."""
_FOLDED = {"arm": ("link", "links"), "hand": ("finger", "fingers"), "intention": ("done", "done")}
"""What is said of the one node, or of the several, that are folded into one of this type."""
_LONGEST = 28  # letters of a label: the longest names of parts and cameras of a robot have as many


class Folded(NamedTuple):
    """The part of the graph that is drawn."""

    nodes: dict[str, str]
    """Type, by name."""
    edges: list[EdgeKey]
    """Sorted; of folded nodes, the ends are where these were folded into."""
    labels: dict[str, str]
    """Of the nodes, also how much is folded into them."""


def fold(memory: Memory) -> Folded:
    """Fold links into their arm, fingers into their hand, and actions that are over into their intention.

    Of more than a picture can show as much is drawn of what each agent made.
    """
    nodes = {node.name: node for node in memory.nodes() if node.type not in _LEFT_OUT and node.name != TIMELINE}
    edges = [edge for edge in memory.edges() if edge.src in nodes and edge.dst in nodes]
    into = _folded_into(nodes, [edge.key for edge in edges])
    unfolded = [node for name, node in nodes.items() if name not in into]
    unfolded.sort(key=lambda node: node.name != WORLD)  # others hang from it, and it tells how many are left out
    drawn = {node.name for node in shared_out(unfolded, MOST_NODES)}
    ends = {name: end for name in nodes if (end := into.get(name, name)) in drawn}
    between = [edge for edge in edges if edge.type != _IMAGES_SHOW and _is_drawn(edge, ends)]
    kept = {(ends[edge.src], ends[edge.dst], edge.type) for edge in shared_out(between, MOST_EDGES)}
    labels = {name: drawable(name, _LONGEST) for name in nodes if name in drawn}
    for name, count in Counter(whole for whole in into.values() if whole in drawn).items():
        labels[name] += f" ({count} {_FOLDED[nodes[name].type][count > 1]})"
    if WORLD in labels and (left := len(unfolded) - len(drawn)):
        labels[WORLD] += f" ({left} nodes are not drawn)"
    return Folded({name: nodes[name].type for name in labels}, sorted(kept), labels)


def _is_drawn(edge: Edge, ends: Mapping[str, str]) -> bool:
    """Whether both ends are drawn, and are not folded into one."""
    if edge.src not in ends or edge.dst not in ends:
        return False
    return ends[edge.src] != ends[edge.dst] or edge.src == edge.dst


def _folded_into(nodes: Mapping[str, Node], edges: list[EdgeKey]) -> dict[str, str]:
    """What each folded node is folded into."""
    above = {dst: src for wanted in ("RT", "has") for src, dst, type in edges if type == wanted}  # parts know best
    into: dict[str, str] = {}
    for name, node in nodes.items():
        whole = _WHOLES.get(node.type, "")
        if whole and (node.type != "action" or node.get("status") in ENDED):
            found = _ancestor(name, above, nodes, whole)
            into |= {name: found} if found else {}
    return into


def _ancestor(name: str, above: Mapping[str, str], nodes: Mapping[str, Node], type: str) -> str:
    """The nearest node of a type above another one; empty if there is none."""
    seen = {name}
    while (name := above.get(name, "")) and name not in seen:
        if nodes[name].type == type:
            return name
        seen.add(name)
    return ""
