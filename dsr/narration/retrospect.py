"""Answers questions of the past, of time and of cause, from the timeline and the percepts."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from dsr.graph.elements import Edge, Node
from dsr.narration.answer import Response, joined, understood
from dsr.narration.asked import span_asked
from dsr.narration.happenings import entry_statements
from dsr.narration.naming import is_robot, name_of, node_of, nodes_called
from dsr.narration.past import doings, limits_of_memory, relations_during, told_during
from dsr.narration.persons import thing_by_person, world_of
from dsr.narration.places import latest_explanation, place_of_thing, relations_of, surprise_of, why_unseen
from dsr.narration.present import where
from dsr.narration.questions import Query
from dsr.narration.statements import (
    Basis,
    Moment,
    Statement,
    Subject,
    is_seen,
    length_of_time,
    percept_evidence,
)
from dsr.timeline import SURPRISING, recall
from dsr.vocabulary.relations import THINGS, is_present
from dsr.vocabulary.sentences import listed, rejected_sentences

DID = {
    "pick": "picked up", "put": "put down", "drop": "let go of", "move": "moved", "remove": "taken away",
    "fall": "seen to fall", "appear": "seen to appear", "vanish": "missed",
}  # fmt: skip
"""What was done, by the word of a question."""


def where_at(moment: Moment, query: Query) -> Response:
    """Where a thing is, or was at a time."""
    span = span_asked(moment, query)
    if span is None:
        found = where(moment, msgspec.structs.replace(query, things=query.things[-1:]))
        return msgspec.structs.replace(found, names=tuple(_of_kind(moment, query, found.names)))
    name = name_of(moment, query.things[-1])
    told = told_during(moment, relations_during(moment, name, span), span)
    limits = limits_of_memory(moment, span, told)
    if not told:
        return understood(f"The timeline does not tell where {name} was {span.words}. {limits}".strip())
    names = [one.names[0 if one.names[1] == name else 1] for one in told]
    names = _of_kind(moment, query, names)
    return understood(f"{joined(told)} {limits}".strip(), told, names=list(dict.fromkeys(names)))


def _of_kind(moment: Moment, query: Query, names: Iterable[str]) -> list[str]:
    """Of the places of a thing those of the kind that is asked for, as in `which box is it in`; or else all."""
    wanted = {node.name for node in nodes_called(moment, query.things[0])} if len(query.things) > 1 else set()
    chosen = [name for name in names if name in wanted]
    return chosen or list(names)


def last_seen(moment: Moment, query: Query) -> Response:
    """When a thing or a person was last seen, and for how long it has been unseen."""
    node = node_of(moment, query.things[0])
    last = node.get("last_seen")
    if last is None:
        return understood(f"{node.name} was never seen.")
    if is_seen(node, moment.now):
        text = f"{node.name} is seen now, last {moment.when(last)}."
    else:
        reason = why_unseen(moment, node.name)
        text = f"{node.name} was last seen {moment.when(last)}{f'; by belief, {reason}' if reason else ''}."
    return understood(text, [_percept(moment, node.name, text)], time=last)


def last_seen_by(moment: Moment, query: Query) -> Response:
    """When a person, or the robot, last saw a thing."""
    if is_robot(query.things[0]):
        return last_seen(moment, msgspec.structs.replace(query, things=query.things[1:]))
    person, node = node_of(moment, query.things[0]).name, node_of(moment, query.things[1])
    world = world_of(moment, person)
    known = world.memory.get_node(node.name)
    if known is None or "last_seen" not in known:
        return understood(f"{person} has never seen {node.name}.")
    told = thing_by_person(moment, world, person, node)
    text = f"{person} saw {node.name} last {moment.when(known['last_seen'])}. {joined(told)}"
    return understood(text, told, time=known["last_seen"])


def has_seen(moment: Moment, query: Query) -> Response:
    """Whether the robot or a person has seen a thing: ever, or since a time."""
    found, span = last_seen_by(moment, query), span_asked(moment, query)
    since = 0.0 if span is None else span.begin
    seen = found.time is not None and found.time >= since
    text = f"{'Yes' if seen else 'No'}: {found.text}"
    return understood(text, found.evidence, verdict=seen, time=found.time)


def when_was(moment: Moment, query: Query) -> Response:
    """When a thing was last picked up, put down, moved, ...: the newest event that tells so."""
    name, span = name_of(moment, query.things[0]), span_asked(moment, query)
    told = doings(moment, name, query.word, span)
    if not told:
        then = "" if span is None else f" {span.words}"
        return understood(f"Nothing tells that {name} was {DID[query.word]}{then}.")
    return understood(told[-1].text, told[-1:], time=told[-1].time, since=told[-1].since)


def since_when(moment: Moment, query: Query) -> Response:
    """Since when a relation holds that holds now, and for how long."""
    thing, other = (node_of(moment, asked) for asked in query.things)
    edge = moment.memory.get_edge(thing.name, other.name, "in" if query.relation == "in" else "on")
    place = place_of_thing(moment, thing)
    if edge is None or "since" not in edge:
        return understood(f"That is not so now. {place.text}", [place])
    length = length_of_time(moment.now - edge["since"])
    return understood(f"For {length}. {place.text}", [place], time=edge["since"])


def why_so(moment: Moment, query: Query) -> Response:
    """Why a thing is believed to be on or in another: percepts, contact, the explanation and what was rejected."""
    thing = node_of(moment, query.things[-2])
    other = node_of(moment, query.things[-1])
    place = place_of_thing(moment, thing)
    edge = next((edge for kind in ("on", "in") if (edge := moment.memory.get_edge(thing.name, other.name, kind))), None)
    if edge is None:
        return understood(f"That is not so. {place.text}", [place])
    parts = [place]
    if source := edge.get("source", ""):
        since = f" for {length_of_time(moment.now - edge['since'])}" if "since" in edge else ""
        words = {"contact": "the two touch in the simulation of physics", "explanation": "an explanation put it there"}
        parts.append(_believed(f"By belief, {words.get(source, source)}{since}.", thing.name, other.name))
    parts += explanations_of(moment, thing.name)
    return understood(joined(parts), parts)


def why_state(moment: Moment, query: Query) -> Response:
    """Why a thing is surprising, gone, unseen or there; why somebody cannot see it."""
    node = node_of(moment, query.things[-1])
    place = [place_of_thing(moment, node)] if node.type in THINGS else []
    if query.word == "surprising":
        return _why_surprising(moment, node.name, node.get("surprise", ""))
    if query.word == "gone" and is_present(node):
        return understood(f"{node.name} is not believed to be gone. {joined(place)}", place)
    if query.word in ("unseen", "") and (not is_seen(node, moment.now) or len(query.things) > 1):
        is_by_other = len(query.things) > 1 and not is_robot(query.things[0])
        viewer = node_of(moment, query.things[0]).name if is_by_other else None
        edges = [edge for edge in moment.memory.edges("sees", dst=node.name) if viewer in (None, edge.src)]
        names = sorted({str(hider) for edge in edges if (hider := edge.get("covered_by") or edge.get("hidden_by"))})
        whom = f" from {viewer}" if viewer else ""
        verb = "hides" if len(names) == 1 else "hide"
        hidden = f"{listed(names)} {verb} {node.name}{whom}, by belief."
        text = hidden if names else unknown_cause(moment, node, edges) or f"Nothing is known to hide {node.name}{whom}."
        names = names or [edge.src for edge in relations_of(moment, node.name)[2]]
        return understood(f"{text} {joined(place)}", [_believed(text, node.name), *place], names=names)
    told = [*place, *explanations_of(moment, node.name)]
    return understood(joined(told), told)


def unknown_cause(moment: Moment, node: Node, sights: Iterable[Edge]) -> str:
    """What is known of why a thing is unseen that somebody should see where it is believed; empty if nobody should."""
    expected = sorted(edge.src for edge in sights if edge.get("visible") is True)
    if not expected or is_seen(node, moment.now):
        return ""
    text = f"{listed(expected)} should see {node.name} there, so something that the robot does not know hides it."
    holders = [edge.src for edge in relations_of(moment, node.name)[2]]
    return f"{text} {listed(holders)} took it out of sight." if holders else text


def why_moved(moment: Moment, query: Query) -> Response:
    """Why a thing moved, fell or went: what was done with it, and the explanation."""
    node = node_of(moment, query.things[0])
    told = [*doings(moment, node.name, "move")[-1:], *explanations_of(moment, node.name)]
    unique = list({one.text: one for one in told}.values())
    return understood(joined(unique) or f"Nothing tells why {node.name} moved.", unique)


def _why_surprising(moment: Moment, name: str, why: str) -> Response:
    told = explanations_of(moment, name)
    if why:
        told = [surprise_of(moment.memory.node(name)), *told]
        return understood(joined(told), told)
    before = entry_statements(moment, recall(moment.memory, kind=SURPRISING, participants=name)[-1:])
    told = [*before, *told]
    return understood(f"{name} is not surprising now. {joined(told)}".strip(), told)


def explanations_of(moment: Moment, name: str) -> list[Statement]:
    """The newest explanation in which a thing takes part, with the best of those that were rejected."""
    entry = latest_explanation(moment, name)
    if entry is None:
        return []
    told = entry_statements(moment, [entry])
    rejected = rejected_sentences(entry.details)[:1]
    score = f" ({entry.details['score']:.1f})" if "score" in entry.details else ""
    return told + [
        Statement(
            text=f"It preferred this{score} to: {one.sentence} ({one.score}); less is better.",
            subject=Subject.HAPPENED, basis=Basis.OWN, names=entry.participants, time=entry.begin,
        )
        for one in rejected
    ]  # fmt: skip


def _percept(moment: Moment, name: str, text: str) -> Statement:
    return Statement(
        text=text, subject=Subject.SIGHT, basis=Basis.PERCEIVED, names=(name,), evidence=percept_evidence(moment, name)
    )  # fmt: skip


def _believed(text: str, *names: str) -> Statement:
    return Statement(text=text, subject=Subject.PLACE, basis=Basis.BELIEVED, names=names)
