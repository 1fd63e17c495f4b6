"""Answers what-if questions: has the belief simulated with a change, and tells what would come of it."""

from __future__ import annotations

from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.imagining import Thought
from dsr.math3d.transforms import Pose
from dsr.narration.answer import Response, understood
from dsr.narration.naming import node_of
from dsr.narration.questions import Query
from dsr.narration.statements import Basis, Moment, Statement, Subject
from dsr.spatial import Box, read_scene
from dsr.vocabulary.sentences import listed
from dsr.vocabulary.what_if import Answer, Question, Supposed

_SECONDS = 2.0
"""s to simulate: a thing that loses its support has fallen from a table within half of that"""
_GAP = 0.0005
"""m between a thing and what it is put on: nothing may reach into another at the beginning"""
_CHANGED = {"remove": 1, "hold": 1, "put": 2}
"""Things that a change is about, by its word."""
_MOVED = 0.01
"""m from which a thing counts as moved: twice what a stack settles by"""


def supposed(moment: Moment, query: Query) -> Thought[Response]:
    """Answer `what if A were removed?`, `would B fall if A were removed?`: yields the question, ends with the response.

    Raises:
        UnknownNameError: for a name of no node.
    """
    change = _change(moment, query)
    if isinstance(change, str):
        return understood(change)
    found = yield Question(_SECONDS, (change,))
    if found.refused:
        return understood(f"That was not simulated: {found.refused}.")
    moved = sorted(name for name, metres in found.effects.items() if metres > _MOVED and name != change.object)
    statements = [_outcome(found, name) for name in sorted({*moved, *({change.object} & found.poses.keys())})]
    if query.kind == "would":
        return _verdict(moment, query, found, moved, statements)
    told = " ".join(one.text for one in statements if one.names[0] in moved)
    own = " ".join(one.text for one in statements if one.names[0] not in moved)
    text = " ".join(part for part in (told or "Nothing else would move.", own) if part)
    return understood(text, statements, names=moved)


def _verdict(moment: Moment, query: Query, found: Answer, moved: list[str], statements: list[Statement]) -> Response:
    """Yes or no to whether one thing, or any, would move."""
    if len(query.things) == _CHANGED[query.word]:
        text = " ".join(one.text for one in statements if one.names[0] in moved) or "Nothing else would move."
        return understood(f"{'Yes' if moved else 'No'}: {text}", statements, verdict=bool(moved), names=moved)
    name = node_of(moment, query.things[0]).name
    moves = found.moved.get(name, 0.0) > _MOVED
    evidence = statements if any(one.names[0] == name for one in statements) else [*statements, _outcome(found, name)]
    why = next(one.text for one in evidence if one.names[0] == name)
    is_effect = found.effects.get(name, 0.0) > _MOVED
    told = "It would stay" if not moves else "It would move" if is_effect else "It would move anyway"
    return understood(f"{told}: {why}", evidence, verdict=moves, names=moved)


def _change(moment: Moment, query: Query) -> Supposed | str:
    """The change that is asked about, or why there is none."""
    thing = node_of(moment, query.things[-2 if query.word == "put" else -1])
    if query.word == "remove":
        return Supposed.remove(thing.name)
    if query.word == "hold":
        return Supposed.hold(thing.name)
    support = node_of(moment, query.things[-1])
    boxes = read_scene(moment.memory).boxes
    for node in (thing, support):
        if node.name not in boxes:
            return f"Nobody knows where {node.name} is, or how large."
    return Supposed.place(thing.name, _on_top(moment, thing, boxes[support.name]))


def _on_top(moment: Moment, thing: Node, support: Box) -> Pose:
    """world_from_thing above the middle of a support, turned as the thing is now."""
    now = moment.memory.transform(WORLD, thing.name, types=BELIEVED)
    below = now.t[2] - read_scene(moment.memory).boxes[thing.name].bottom
    x, y, _ = support.pose.t
    return Pose((x, y, support.top + below + _GAP), now.q)


def _outcome(found: Answer, name: str) -> Statement:
    """Where a thing would be in the end."""
    supports = [*found.rests_on.get(name, ()), *(["the floor"] if name in found.on_floor else [])]
    rest = f"rest on {listed(supports)}" if supports else "be in the air"
    far = found.moved.get(name, 0.0)
    away = f", {far:.2f} m from where it is now" if far > _MOVED else ""
    return Statement(
        text=f"{name} would {rest} then{away}.", subject=Subject.PLACE, basis=Basis.BELIEVED, names=(name, *supports),
        evidence={"moved_m": far, "rests_on": supports, "simulated_s": found.seconds, "at_rest": found.at_rest},
    )  # fmt: skip
