"""Answers questions of the past, of time and of cause, from the timeline and the percepts."""

from __future__ import annotations

import msgspec

from dsr.narration.account import LATELY
from dsr.narration.answer import Response, joined, understood
from dsr.narration.happenings import entry_statements, happening_statements
from dsr.narration.naming import is_robot, node_of
from dsr.narration.past import doings, relations_at, told_at
from dsr.narration.persons import thing_by_person, world_of
from dsr.narration.places import latest_explanation, place_of_thing, surprise_of, why_unseen
from dsr.narration.present import time_asked, where
from dsr.narration.questions import Query
from dsr.narration.statements import (
    Basis,
    Moment,
    Statement,
    Subject,
    ago,
    is_seen,
    length_of_time,
    percept_evidence,
)
from dsr.timeline import SURPRISING
from dsr.timeline import query as timeline_query
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, UNKNOWN
from dsr.vocabulary.relations import THINGS, is_present
from dsr.vocabulary.sentences import listed, rejected_sentences

_DID = {
    "pick": "picked up", "put": "put down", "drop": "let go of", "move": "moved", "remove": "taken away",
    "fall": "seen to fall", "appear": "seen to appear", "vanish": "missed",
}  # fmt: skip
_BY_HAND = {"pick": (PICK,), "put": (PLACE,), "drop": (RELEASE,), "move": (PICK, PLACE), "remove": (PICK,)}
"""Inferred actions that tell who did something, by the word of a question."""


def where_then(moment: Moment, query: Query) -> Response:
    """Where a thing was at a time; without a time, where it was lately."""
    time = time_asked(moment, query)
    if time is None:
        return where(moment, query)
    node = node_of(moment, query.things[0])
    entries = relations_at(moment, node.name, time)
    told = told_at(moment, entries, time)
    if not told:
        return understood(f"The timeline does not tell where {node.name} was {ago(moment.now - time)}.")
    names = [entry.participants[0 if entry.kind == "grasping" else 1] for entry in entries]
    return understood(joined(told), told, names=names)


def last_seen(moment: Moment, query: Query) -> Response:
    """When a thing or a person was last seen, and for how long it has been unseen."""
    node = node_of(moment, query.things[0])
    last = node.get("last_seen")
    if last is None:
        return understood(f"{node.name} was never seen.")
    if is_seen(node, moment.now):
        text = f"{node.name} is seen now, last {ago(moment.now - last)}."
    else:
        reason = why_unseen(moment, node.name)
        text = f"{node.name} was last seen {ago(moment.now - last)}{f'; by belief, {reason}' if reason else ''}."
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
    text = f"{person} saw {node.name} last {ago(moment.now - known['last_seen'])}. {joined(told)}"
    return understood(text, told, time=known["last_seen"])


def when_was(moment: Moment, query: Query) -> Response:
    """When a thing was last picked up, put down, moved, ...: the newest event that tells so."""
    node = node_of(moment, query.things[0])
    told = doings(moment, node.name, query.word)
    if not told:
        return understood(f"Nothing tells that {node.name} was {_DID[query.word]}.")
    return understood(told[-1].text, told[-1:], time=told[-1].time)


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
    parts += _explanations(moment, thing.name)
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
        viewer = node_of(moment, query.things[0]).name if len(query.things) > 1 else None
        edges = [edge for edge in moment.memory.edges("sees", dst=node.name) if viewer in (None, edge.src)]
        names = sorted({str(hider) for edge in edges if (hider := edge.get("covered_by") or edge.get("hidden_by"))})
        whom = f" from {viewer}" if viewer else ""
        verb = "hides" if len(names) == 1 else "hide"
        hidden = f"{listed(names)} {verb} {node.name}{whom}, by belief."
        text = hidden if names else f"Nothing is known to hide {node.name}{whom}."
        return understood(f"{text} {joined(place)}", [_believed(text, node.name), *place], names=names)
    told = [*place, *_explanations(moment, node.name)]
    return understood(joined(told), told)


def why_moved(moment: Moment, query: Query) -> Response:
    """Why a thing moved, fell or went: what was done with it, and the explanation."""
    node = node_of(moment, query.things[0])
    told = [*doings(moment, node.name, "move")[-1:], *_explanations(moment, node.name)]
    unique = list({one.text: one for one in told}.values())
    return understood(joined(unique) or f"Nothing tells why {node.name} moved.", unique)


def happened(moment: Moment, query: Query) -> Response:
    """What happened since a time, to a thing or at all."""
    since = time_asked(moment, query)
    told = happening_statements(moment, moment.now - LATELY if since is None else since)
    if query.things:
        name = node_of(moment, query.things[0]).name
        told = [one for one in told if name in one.names]
    return understood(joined(told) or "Nothing is known to have happened.", told)


def who_did(moment: Moment, query: Query) -> Response:
    """Who did something with a thing last, as inferred."""
    node = node_of(moment, query.things[0])
    entries = timeline_query(moment.memory, kind=_BY_HAND[query.word], participants=node.name)
    mine = [entry for entry in entries if entry.participants[:1] == (node.name,)]
    if not mine:
        told = _explanations(moment, node.name)
        return understood(f"Nobody is known to have {_DID[query.word]} {node.name}. {joined(told)}".strip(), told)
    told = entry_statements(moment, mine[-1:])
    who = [name for name in mine[-1].participants[1:2] if name != UNKNOWN]
    return understood(joined(told), told, names=who, time=mine[-1].begin)


def _why_surprising(moment: Moment, name: str, why: str) -> Response:
    told = _explanations(moment, name)
    if why:
        told = [surprise_of(moment.memory.node(name)), *told]
        return understood(joined(told), told)
    before = entry_statements(moment, timeline_query(moment.memory, kind=SURPRISING, participants=name)[-1:])
    told = [*before, *told]
    return understood(f"{name} is not surprising now. {joined(told)}".strip(), told)


def _explanations(moment: Moment, name: str) -> list[Statement]:
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
