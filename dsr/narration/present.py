"""Answers questions of place, possession, visibility, belief and intention, as of now."""

from __future__ import annotations

import msgspec

from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Edge, Node
from dsr.narration.answer import Response, joined, understood
from dsr.narration.asked import span_asked
from dsr.narration.calendar import TimeSpan
from dsr.narration.chances import chances_of_thing
from dsr.narration.doings import holding_statements, sight_of, wish_statements
from dsr.narration.naming import is_robot, node_of, nodes_called
from dsr.narration.past import contents_during, limits_of_memory, told_during
from dsr.narration.persons import thing_by_person, world_of
from dsr.narration.places import place_of_thing, relations_of, why_unseen
from dsr.narration.questions import Query
from dsr.narration.sides import SIDE_WORDS, SIDES, at_side
from dsr.narration.statements import (
    Basis,
    Moment,
    Statement,
    Subject,
    is_seen,
    percept_evidence,
    place_of,
    place_words,
    sentence_begin,
)
from dsr.spatial import read_scene
from dsr.visibility import CAMERA, PERSON
from dsr.vocabulary.relations import THINGS, is_present
from dsr.vocabulary.sentences import listed

_SPATIAL = {"above": "above", "below": "below", "near": "close_to", "next": "next_to"}
"""Relations of questions that follow from the places of boxes, with their names in `dsr.spatial`."""
_BODIES = (PERSON, "hand")
_HOLDERS = ("hand", "gripper")
_EDGES = {"on": ("on",), "in": ("in",), "under": ("on", "in")}


def where(moment: Moment, query: Query) -> Response:
    """Where a thing, a person or a part of the robot is."""
    node = node_of(moment, query.things[0])
    if node.type in THINGS:
        return _where_thing(moment, node)
    pose = moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    if pose is None:
        return understood(f"Nobody knows where {node.name} is.")
    seen = node.type != PERSON or is_seen(node, moment.now)
    words = place_words(place_of(pose), height=True)
    text = f"{node.name} is {words}." if seen else f"{node.name} is not there; last seen {words}."
    told = Statement(
        text=text, subject=Subject.PLACE, basis=Basis.PERCEIVED, names=(node.name,),
        evidence=percept_evidence(moment, node.name),
    )  # fmt: skip
    return understood(text, [told])


def _where_thing(moment: Moment, node: Node) -> Response:
    """Where a thing is believed to be, and where else it could be."""
    told = [place_of_thing(moment, node)]
    if (chances := chances_of_thing(moment, node)) is not None:
        told.append(chances)
    supports, contents, holders = relations_of(moment, node.name)
    names = [edge.dst for edge in (*contents, *supports)] or [edge.src for edge in holders]
    return understood(joined(told), told, names=names)


def where_by(moment: Moment, query: Query) -> Response:
    """Where a person believes a thing to be."""
    person, node = _person_and_thing(moment, query)
    world = world_of(moment, person)
    told = thing_by_person(moment, world, person, node)
    supports, contents, _ = relations_of(world, node.name)
    return understood(joined(told), told, names=[edge.dst for edge in (*contents, *supports)])


def contents(moment: Moment, query: Query) -> Response:
    """What is on, in or under a thing, now or at a time."""
    node, relation, span = node_of(moment, query.things[-1]), query.relation, span_asked(moment, query)
    if span is not None:
        return _contents_then(moment, node, relation, span)
    where_words = f"{'next to' if relation == 'next' else relation} {node.name}"
    if relation in SIDES:
        names, viewer = at_side(moment, node, relation, query.view, bodies=query.word == "body")
        where_words = f"{SIDE_WORDS[relation]} {node.name}, as {viewer} sees it"
    elif relation in _SPATIAL:
        margins = read_scene(moment.memory).margins(_SPATIAL[relation], destinations=node.name)
        names = sorted(fact.source for fact, margin in margins.items() if margin >= 0.0)
    elif relation == "under":
        names = sorted({edge.dst for edge in moment.memory.edges("on", src=node.name)} | _inside(moment, node.name))
    else:
        names = sorted(edge.src for edge in moment.memory.edges(relation, dst=node.name))
    if len(query.things) > 1:
        wanted = {one.name for one in nodes_called(moment, query.things[0])}
        names = [name for name in names if name in wanted]
    if query.word == "body":
        names = [name for name in names if moment.memory.node(name).type in _BODIES]
    told = [place_of_thing(moment, one) for name in names if (one := _thing(moment, name)) is not None]
    if not names:
        return understood(f"{'Nobody' if query.word == 'body' else 'Nothing'} is known to be {where_words}.")
    return understood(f"{sentence_begin(where_words)}: {listed(names)}. {joined(told)}".strip(), told, names=names)


def contents_by(moment: Moment, query: Query) -> Response:
    """What a person believes to be on or in a thing."""
    person, node = _person_and_thing(moment, query)
    world = world_of(moment, person)
    kinds = _EDGES.get(query.relation, ())
    names = sorted(edge.src for kind in kinds for edge in world.memory.edges(kind, dst=node.name))
    if not names:
        return understood(f"{person} knows of nothing {query.relation} {node.name}.")
    told = [
        one for name in names if (thing := moment.memory.get_node(name)) is not None
        for one in thing_by_person(moment, world, person, thing)
    ]  # fmt: skip
    return understood(joined(told), told, names=names)


def any_so(moment: Moment, query: Query) -> Response:
    """Whether there is anything, or any of a kind, on, in or under a thing."""
    found = contents(moment, query)
    return understood(_yes(bool(found.names), found.text), found.evidence, verdict=bool(found.names), names=found.names)


def is_so(moment: Moment, query: Query) -> Response:
    """Whether a thing is on, in, under or near another, now or at a time."""
    thing, other = (node_of(moment, asked) for asked in query.things)
    span = span_asked(moment, query)
    upper, lower = (other, thing) if query.relation == "under" else (thing, other)
    kinds = _EDGES.get(query.relation, ())
    if span is not None and kinds:
        found = contents_during(moment, lower.name, kinds, span)
        told = told_during(moment, [one for one in found if one.participants[0] == upper.name], span)
        text = joined(told) or "The timeline does not tell so."
        return understood(_ended(_yes(bool(told), text), moment, span, told), told, verdict=bool(told))
    if query.relation in SIDES:
        bodies = thing.type in _BODIES
        names, viewer = at_side(moment, other, query.relation, query.view, bodies=bodies, only=[thing.name])
        so = f"{thing.name} is {'' if names else 'not '}{SIDE_WORDS[query.relation]} {other.name}, as {viewer} sees it."
        told = [place_of_thing(moment, one) for one in (thing, other) if one.type in THINGS]
        return understood(f"{_yes(bool(names), so)} {joined(told)}".strip(), told, verdict=bool(names))
    if query.relation in _SPATIAL:
        scene = read_scene(moment.memory).margins(_SPATIAL[query.relation], thing.name, other.name)
        holds = any(margin >= 0.0 for margin in scene.values())
    else:
        holds = any(moment.memory.get_edge(upper.name, lower.name, kind) is not None for kind in kinds)
    subject = upper if upper.type in THINGS else lower
    told = [place_of_thing(moment, subject)] if subject.type in THINGS else []
    return understood(_yes(holds, joined(told)), told, verdict=holds)


def was_so(moment: Moment, query: Query) -> Response:
    """Whether a thing has ever been on or in another, or was so at a time, as far as that is remembered."""
    is_timed = query.when or query.at is not None or query.since is not None
    return is_so(moment, query if is_timed else msgspec.structs.replace(query, when="ever"))


def is_so_by(moment: Moment, query: Query) -> Response:
    """Whether a person believes that a thing is on or in another."""
    person, thing = _person_and_thing(moment, query)
    other, world = node_of(moment, query.things[2]), world_of(moment, person)
    kinds = _EDGES.get(query.relation, ())
    holds = any(world.memory.get_edge(thing.name, other.name, kind) is not None for kind in kinds)
    told = thing_by_person(moment, world, person, thing)
    return understood(_yes(holds, joined(told)), told, verdict=holds)


def knows(moment: Moment, query: Query) -> Response:
    """Whether a person believes that a thing is where the robot believes it to be."""
    person, thing = _person_and_thing(moment, query)
    world = world_of(moment, person)
    told = thing_by_person(moment, world, person, thing)
    known = world.memory.get_node(thing.name)
    right = len(told) == 1 and known is not None and is_present(known)
    return understood(_yes(right, joined(told)), told, verdict=right)


def is_wrong(moment: Moment, query: Query) -> Response:
    """Whether a person believes something else of a thing than the robot."""
    person, thing = _person_and_thing(moment, query)
    told = thing_by_person(moment, world_of(moment, person), person, thing)
    wrong = len(told) > 1
    return understood(_yes(wrong, joined(told)), told, verdict=wrong)


def is_there(moment: Moment, query: Query) -> Response:
    """Whether a thing is in the scene, gone, seen, surprising; or whether there is any thing of a kind."""
    if query.word == "there" and len(found := nodes_called(moment, query.things[0])) != 1:
        there = [node for node in found if is_present(node)]
        told = [place_of_thing(moment, node) for node in there]
        return understood(_yes(bool(there), joined(told)), told, verdict=bool(there), names=[one.name for one in there])
    node = node_of(moment, query.things[0])
    told = [place_of_thing(moment, node)] if node.type in THINGS else []
    seen, present = is_seen(node, moment.now), is_present(node)
    holds = {
        "there": present if node.type != PERSON else seen, "gone": not present, "visible": seen, "unseen": not seen,
        "surprising": node.get("surprising") is True,
    }[query.word]  # fmt: skip
    return understood(_yes(holds, joined(told)), told, verdict=holds)


def sees(moment: Moment, query: Query) -> Response:
    """Whether a person, a camera or the robot sees a thing."""
    return _does_see(moment, query.things[0], node_of(moment, query.things[1]))


def is_visible(moment: Moment, query: Query) -> Response:
    """Whether a thing is visible to somebody."""
    viewer = query.things[1] if len(query.things) > 1 else "robot"
    return _does_see(moment, viewer, node_of(moment, query.things[0]))


def who_sees(moment: Moment, query: Query) -> Response:
    """Which persons and cameras see a thing."""
    node = node_of(moment, query.things[0])
    edges = [edge for edge in moment.memory.edges("sees", dst=node.name) if edge.get("visible") is True]
    names = sorted(edge.src for edge in edges)
    told = [_sight(moment, edge) for edge in sorted(edges, key=lambda edge: edge.src)]
    hidden = why_unseen(moment, node.name)
    text = joined(told) or f"Nobody is believed to see {node.name}{f': {hidden}' if hidden else ''}."
    return understood(text, told, names=names)


def any_sees(moment: Moment, query: Query) -> Response:
    """Whether any person sees a thing."""
    found, persons = who_sees(moment, query), {node.name for node in moment.memory.nodes(PERSON)}
    names = [name for name in found.names if name in persons]
    told = [one for one in found.evidence if one.names[0] in persons]
    nobody = f"nobody is believed to see {node_of(moment, query.things[0]).name}."
    return understood(_yes(bool(names), joined(told) or nobody), told, verdict=bool(names), names=names)


def what_sees(moment: Moment, query: Query) -> Response:
    """Which things, all or those of a kind, a person, a camera or the robot sees."""
    viewer = query.things[-1]
    kind = nodes_called(moment, query.things[0] if len(query.things) > 1 else "thing")
    if not is_robot(viewer):
        statement = sight_of(moment, node_of(moment, viewer))
        wanted = {node.name for node in kind}
        names = [name for name in statement.names[1:] if len(query.things) == 1 or name in wanted]
        return understood(statement.text, [statement], names=names)
    told = [place_of_thing(moment, node) for node in kind if node.type in THINGS and is_seen(node, moment.now)]
    names = [one.names[0] for one in told]
    return understood(f"The robot sees {listed(names) or 'none of them'}.", told, names=names)


def hides(moment: Moment, query: Query) -> Response:
    """What is believed to hide a thing from cameras and persons."""
    node = node_of(moment, query.things[0])
    edges = [edge for edge in moment.memory.edges("sees", dst=node.name) if edge.get("visible") is not True]
    told = [_sight(moment, edge) for edge in sorted(edges, key=lambda edge: edge.src)]
    names = sorted({str(hider) for edge in edges if (hider := edge.get("covered_by") or edge.get("hidden_by"))})
    if not names:
        return understood(f"Nothing is known to hide {node.name}.", told)
    verb = "hides" if len(names) == 1 else "hide"
    return understood(f"{listed(names)} {verb} {node.name}. {joined(told)}", told, names=names)


def holder(moment: Moment, query: Query) -> Response:
    """Who holds a thing, now or at a time."""
    node, span = node_of(moment, query.things[0]), span_asked(moment, query)
    if span is not None:
        told = told_during(moment, contents_during(moment, node.name, ("grasping",), span), span)
        text = joined(told) or f"The timeline tells of nobody who held {node.name} then."
        return understood(_ended(text, moment, span, told), told, names=[one.names[0] for one in told])
    told = [one for one in holding_statements(moment) if one.names[1:] == (node.name,)]
    text = joined(told) or f"Nobody is known to hold {node.name}."
    return understood(text, told, names=[one.names[0] for one in told])


def held(moment: Moment, query: Query) -> Response:
    """What a hand, a gripper or the robot holds."""
    own = is_robot(query.things[0])
    who = "" if own else node_of(moment, query.things[0]).name
    grippers = {node.name for node in moment.memory.nodes("gripper")}
    told = [one for one in holding_statements(moment) if one.names[0] == who or (own and one.names[0] in grippers)]
    text = joined(told) or f"{who or 'The robot'} is not known to hold anything."
    return understood(text, told, names=[one.names[1] for one in told if len(one.names) > 1])


def is_holding(moment: Moment, query: Query) -> Response:
    """Whether a hand, a gripper or the robot holds a thing."""
    found, thing = held(moment, query), node_of(moment, query.things[1])
    holds = thing.name in found.names
    return understood(_yes(holds, found.text), found.evidence, verdict=holds)


def any_held(moment: Moment, query: Query) -> Response:
    """Whether anybody holds a thing."""
    found = holder(moment, query)
    return understood(_yes(bool(found.names), found.text), found.evidence, verdict=bool(found.names), names=found.names)


def any_seen(moment: Moment, query: Query) -> Response:
    """Whether somebody sees any thing."""
    found = what_sees(moment, query)
    return understood(_yes(bool(found.names), found.text), found.evidence, verdict=bool(found.names), names=found.names)


def is_empty(moment: Moment, query: Query) -> Response:
    """Whether a hand or gripper holds nothing, or nothing is in a box or cup."""
    if is_robot(query.things[0]) or node_of(moment, query.things[0]).type in _HOLDERS:
        found = held(moment, query)
        told = [one for one in found.evidence if not any(claim.relation == "touching" for claim in one.claims)]
        full = [name for one in told for name in one.names[1:]]
        text = found.text if told or not found.evidence else f"{found.evidence[0].names[0]} only touches something."
        return understood(_yes(not full, text), found.evidence, verdict=not full, names=full)
    found = contents(moment, msgspec.structs.replace(query, relation="in"))
    return understood(_yes(not found.names, found.text), found.evidence, verdict=not found.names, names=found.names)


def wants(moment: Moment, query: Query) -> Response:
    """What the robot wants, does, and waits for."""
    told = wish_statements(moment)
    return understood(joined(told) or "The robot wants nothing.", told)


def which(moment: Moment, query: Query) -> Response:
    """Which things there are, of a kind or of all kinds, also on or in something, and how many."""
    if query.relation:
        inside = contents(moment, query)
        return understood(f"{len(inside.names)}. {inside.text}", inside.evidence, names=inside.names)
    found = [node for node in nodes_called(moment, query.things[0] if query.things else "thing") if is_present(node)]
    told = [place_of_thing(moment, node) for node in found]
    names = [node.name for node in found]
    text = f"{len(names)} of that kind: {listed(names)}." if names else "Nothing of that kind."
    return understood(text, told, names=names)


def _contents_then(moment: Moment, node: Node, relation: str, span: TimeSpan) -> Response:
    found = contents_during(moment, node.name, _EDGES.get(relation, ()), span)
    told = told_during(moment, found, span)
    text = joined(told) or f"The timeline tells of nothing {relation} {node.name} then."
    return understood(_ended(text, moment, span, told), told, names=list(dict.fromkeys(one.names[0] for one in told)))


def _ended(text: str, moment: Moment, span: TimeSpan, told: list[Statement]) -> str:
    """An answer about the past, with how well that is remembered."""
    return f"{text} {limits_of_memory(moment, span, told)}".strip()


def _does_see(moment: Moment, asked: str, thing: Node) -> Response:
    if is_robot(asked):
        seen = is_seen(thing, moment.now)
        told = [place_of_thing(moment, thing)] if thing.type in THINGS else []
        return understood(_yes(seen, joined(told)), told, verdict=seen)
    viewer = node_of(moment, asked)
    edge = moment.memory.get_edge(viewer.name, thing.name, "sees")
    if viewer.type not in (CAMERA, PERSON):
        return understood(f"{viewer.name} is a {viewer.type}: only persons, cameras and the robot see.")
    if edge is None or (viewer.type == PERSON and not is_seen(viewer, moment.now)):
        away = viewer.type == PERSON and not is_seen(viewer, moment.now)
        why = f"{viewer.name} is not there." if away else f"{thing.name} is not in the view of {viewer.name}."
        return understood(_yes(False, why), verdict=False)
    told = [_sight(moment, edge)]
    return understood(_yes(edge.get("visible") is True, joined(told)), told, verdict=edge.get("visible") is True)


def _sight(moment: Moment, edge: Edge) -> Statement:
    """What somebody sees of a thing, by the places that are believed."""
    share, hider = edge.get("share", 0.0), edge.get("covered_by") or edge.get("hidden_by") or ""
    seen = edge.get("visible") is True
    why = f"; {hider} hides most of the rest" if hider and share < 1.0 else ""
    text = f"{edge.src} is believed {'' if seen else 'not '}to see {edge.dst} ({share:.0%} of it{why})."
    evidence = {"share": share, "hidden_by": hider, **percept_evidence(moment, edge.dst)}
    return Statement(
        text=text, subject=Subject.SIGHT, basis=Basis.BELIEVED, names=(edge.src, edge.dst), evidence=evidence
    )  # fmt: skip


def _person_and_thing(moment: Moment, query: Query) -> tuple[str, Node]:
    return node_of(moment, query.things[0]).name, node_of(moment, query.things[1])


def _thing(moment: Moment, name: str) -> Node | None:
    node = moment.memory.get_node(name)
    return node if node is not None and node.type in THINGS else None


def _inside(moment: Moment, name: str) -> set[str]:
    """Names of what a hollow thing stands over."""
    return {edge.src for edge in moment.memory.edges("in", dst=name)}


def _yes(holds: bool, because: str) -> str:
    return f"{'Yes' if holds else 'No'}{f': {because}' if because else '.'}"
