"""Finds the node that a question means: by its name, or by words that fit one node only (`the first cup`)."""

from __future__ import annotations

from dsr.errors import DsrError, suggest
from dsr.graph.elements import Node
from dsr.narration.statements import Moment
from dsr.timeline import recall
from dsr.vocabulary.relations import SURFACES, THINGS
from dsr.vocabulary.sentences import listed

ROBOT = "robot"
"""Word for the robot itself, whatever its node is called."""
_SELF = (ROBOT, "you", "arm")
_NOT_MEANT = ("event", "situation", "summary", "timeline", "world", "mind")
_ALSO_CALLED = {"container": ("box", "container"), "cup": ("cup", "mug"), "cube": ("cube", "block")}
"""Other words for types of things."""


class UnknownNameError(DsrError):
    """No node, or several, is meant by the words of a question."""

    def __init__(self, asked: str, why: str) -> None:
        super().__init__(why)
        self.asked = asked


def node_of(moment: Moment, asked: str) -> Node:
    """The node that is meant. Raises `UnknownNameError`."""
    nodes = [node for node in moment.memory.nodes() if node.type not in _NOT_MEANT and not node.name.startswith(".")]
    joined = asked.replace(" ", "_")
    exact = [node for node in nodes if node.name.lower() in (asked, joined)]
    if len(exact) == 1:
        return exact[0]
    words = set(asked.split())
    fitting = exact or [node for node in nodes if words <= _words(node)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        names = listed(sorted(node.name for node in fitting)[:8])
        raise UnknownNameError(asked, f"{asked!r} may be {names}: which one?")
    known = sorted(node.name for node in nodes if node.type in (*THINGS, *SURFACES, "person"))
    raise UnknownNameError(asked, f"nothing is called {asked!r}; {suggest(joined, known)}")


def name_of(moment: Moment, asked: str) -> str:
    """The name that is meant, also of what is no node any more, but remembered. Raises `UnknownNameError`."""
    try:
        return node_of(moment, asked).name
    except UnknownNameError:
        joined = asked.replace(" ", "_")
        past = {name for entry in recall(moment.memory) for name in entry.participants}
        if (found := sorted(name for name in past if name.lower() in (asked, joined))) and len(found) == 1:
            return found[0]
        raise


def is_robot(asked: str) -> bool:
    """Whether the robot itself is meant."""
    return asked in _SELF


def nodes_called(moment: Moment, asked: str) -> list[Node]:
    """The things that words in the singular or plural fit (`cubes`, `red cups`), by name; all for `things`."""
    words = {word.removesuffix("s") if not word.endswith("ss") else word for word in asked.split()}
    wanted = words - {"thing", "object"}
    things = sorted(moment.memory.nodes(THINGS), key=lambda node: node.name)
    return [node for node in things if wanted <= _words(node)]


def _words(node: Node) -> set[str]:
    """The words by which a node may be called: parts of its name, its type, and other words for that."""
    return {*node.name.lower().split("_"), node.type, *_ALSO_CALLED.get(node.type, ())}
