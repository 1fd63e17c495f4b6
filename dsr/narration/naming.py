"""Finds the node that a question means: by its name, or by words that fit one node only (`the first cup`)."""

from __future__ import annotations

from collections.abc import Iterable

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
_ALSO_CALLED = {
    "container": ("box", "container"), "cup": ("cup", "mug"), "cube": ("cube", "block"),
    "person": ("person", "human"), "camera": ("camera",), "hand": ("hand",), "box": ("box",), "ball": ("ball",),
}  # fmt: skip
"""Words for types of things."""
_OTHERS = (*SURFACES, "person", "hand", "gripper", "camera")
"""Types of what is no thing, but can be asked about as one of several."""
_PLURALS = {"people": "person", "boxes": "box"}
_NO_KIND = frozenset({"thing", "object", "any", "all", "of", "the", "two", "three", "four", "five", "one"})
"""Words that fit every thing."""


class UnknownNameError(DsrError):
    """No node, or several, is meant by the words of a question."""

    def __init__(self, asked: str, why: str, candidates: tuple[str, ...] = ()) -> None:
        super().__init__(why)
        self.asked = asked
        self.candidates = candidates
        """Names of the nodes that may be meant."""


def node_of(moment: Moment, asked: str) -> Node:
    """The node that is meant. Raises `UnknownNameError`."""
    nodes = [node for node in moment.memory.nodes() if node.type not in _NOT_MEANT and not node.name.startswith(".")]
    joined = asked.replace(" ", "_")
    exact = [node for node in nodes if node.name.lower() in (asked, joined)]
    if len(exact) == 1:
        return exact[0]
    words = set(asked.split())
    fitting = exact or [node for node in nodes if words <= _words(node)]
    if len(fitting) > 1:  # of a hand and its fingers, the hand is meant by `hand`
        fitting = [node for node in fitting if words & {node.type, *_ALSO_CALLED.get(node.type, ())}] or fitting
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        candidates = tuple(sorted(node.name for node in fitting))
        raise UnknownNameError(asked, f"{asked!r} may be {listed(candidates[:8])}: which one?", candidates)
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


def nodes_called(moment: Moment, asked: str, types: Iterable[str] = THINGS) -> list[Node]:
    """The things that words in the singular or plural fit (`cubes`, `red cups`), by name; all for `things`.

    Args:
        moment: the graph, and now.
        asked: the words; `any`, `all` and numbers among them change nothing.
        types: of the nodes among which to look.
    """
    wanted = {_singular(word) for word in asked.split()} - _NO_KIND
    things = sorted(moment.memory.nodes(tuple(types)), key=lambda node: node.name)
    return [node for node in things if wanted <= _words(node)]


def members_called(moment: Moment, asked: str) -> list[Node]:
    """The things, or else the persons, hands or cameras, that words fit (`the two people`), by name."""
    return nodes_called(moment, asked) or nodes_called(moment, asked, _OTHERS)


def _singular(word: str) -> str:
    if word in _PLURALS:
        return _PLURALS[word]
    if word.endswith(("xes", "shes", "ches")):
        return word.removesuffix("es")
    return word if word.endswith("ss") else word.removesuffix("s")


def _words(node: Node) -> set[str]:
    """The words by which a node may be called: parts of its name, its type, and other words for that."""
    return {*node.name.lower().split("_"), node.type, *_ALSO_CALLED.get(node.type, ())}
