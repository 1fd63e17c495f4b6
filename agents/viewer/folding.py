"""Which part of the working memory the graph view draws: parts of arms and hands, and finished actions, are folded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from agents.viewer.routing import EdgeKey
from agents.viewer.texts import drawable
from dsr import Memory, Node
from dsr.graph.schema import SCHEMA_RECORD
from dsr.timeline import EVENT, SITUATION, SUMMARY, TIMELINE
from dsr.vocabulary.intentions import ENDED

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
    """Fold links into their arm, fingers into their hand, and actions that are over into their intention."""
    nodes = {node.name: node for node in memory.nodes() if node.type not in _LEFT_OUT and node.name != TIMELINE}
    edges = [edge.key for edge in memory.edges() if edge.src in nodes and edge.dst in nodes]
    into = _folded_into(nodes, edges)
    ends = {name: into.get(name, name) for name in nodes}
    kept = {
        (ends[src], ends[dst], type)
        for src, dst, type in edges
        if type != _IMAGES_SHOW and (ends[src] != ends[dst] or src == dst)
    }
    labels = {name: drawable(name, _LONGEST) for name in nodes if name not in into}
    for name, count in Counter(into.values()).items():
        labels[name] += f" ({count} {_FOLDED[nodes[name].type][count > 1]})"
    return Folded({name: nodes[name].type for name in labels}, sorted(kept), labels)


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
