"""Answers what happened, who did it, and what was surprising: lately, or at a time of which summaries tell."""

from __future__ import annotations

from collections import defaultdict

import msgspec

from dsr.narration.account import LATELY
from dsr.narration.answer import Response, joined, understood
from dsr.narration.asked import span_asked
from dsr.narration.calendar import TimeSpan
from dsr.narration.happenings import entry_statements, happening_statements
from dsr.narration.naming import ROBOT, is_robot, name_of, node_of, nodes_called
from dsr.narration.past import doings, limits_of_memory, within
from dsr.narration.places import surprise_of
from dsr.narration.questions import Query
from dsr.narration.retrospect import DID, explanations_of
from dsr.narration.statements import Moment, Statement
from dsr.timeline import ACTION, SURPRISES, Entry, recall
from dsr.vocabulary.observed_actions import KINDS, PICK, PLACE, RELEASE, UNKNOWN
from dsr.vocabulary.sentences import listed

_BY_HAND = {
    "pick": (PICK,), "put": (PLACE,), "drop": (RELEASE,), "move": (PICK, PLACE), "remove": (PICK,),
    "hold": (PICK,), "held": (PICK,), "put there": (PLACE, RELEASE),
}  # fmt: skip
"""Inferred actions that tell who did something, by the word of a question."""
_ACTORS = ("hand", "gripper", "person")
_MOST_SENTENCES = 12
"""Sentences of an answer that are told one by one: what a person listens to"""


def happened(moment: Moment, query: Query) -> Response:
    """What happened at a time or lately, to a thing or at all."""
    span = span_asked(moment, query)
    begin, end = (moment.now - LATELY, moment.now) if span is None else (span.begin, span.end)
    told = happening_statements(moment, begin, end)
    if query.things:
        name = name_of(moment, query.things[0])
        told = [one for one in told if name in one.names]
    nothing = "Nothing is known to have happened."
    return understood(_ended(_shortened(told) or nothing, moment, span, told), told)


def surprises(moment: Moment, query: Query) -> Response:
    """What was surprising at a time, or is now or was lately."""
    span = span_asked(moment, query)
    begin, end = (moment.now - LATELY, moment.now) if span is None else (span.begin, span.end)
    entries = recall(moment.memory, kind=SURPRISES, since=begin, until=end)
    told = within(entry_statements(moment, entries), TimeSpan(begin, end, ""))
    if span is None:
        nodes = (node for node in moment.memory.nodes() if node.get("surprising") is True)
        told += [surprise_of(node) for node in sorted(nodes, key=lambda node: node.name)]
    if query.things and not is_robot(query.things[0]):
        name = name_of(moment, query.things[0])
        told = [one for one in told if name in one.names]
    names = dict.fromkeys(name for one in told for name in one.names)
    return understood(_ended(_shortened(told) or "Nothing was surprising.", moment, span, told), told, names=names)


def who_did(moment: Moment, query: Query) -> Response:
    """Who did something with a thing: last, or at a time, as inferred."""
    name, span = name_of(moment, query.things[0]), span_asked(moment, query)
    mine = _deeds(moment, name, _word(query), span)
    if not mine:
        told = [] if span is not None else explanations_of(moment, name)
        then = "" if span is None else f" {span.words}"
        nobody = f"Nobody is known to have {DID[query.word]} {name}{then}. {joined(told)}".strip()
        return understood(_ended(nobody, moment, span, told), told)
    chosen = mine[-1:] if span is None else mine
    told = entry_statements(moment, chosen)
    who = dict.fromkeys(name for entry in chosen for name in entry.participants[1:2] if name != UNKNOWN)
    text = joined(told if len(told) <= _MOST_SENTENCES else counted_deeds(moment, chosen))
    return understood(_ended(text, moment, span, told), told, names=who, time=chosen[-1].begin)


def did_any(moment: Moment, query: Query) -> Response:
    """Whether anybody did something with a thing."""
    found = who_did(moment, query)
    verdict = found.time is not None
    text = f"{'Yes' if verdict else 'No'}: {found.text}"
    return understood(text, found.evidence, verdict=verdict, names=found.names, time=found.time)


def did_by(moment: Moment, query: Query) -> Response:
    """Whether somebody that is named did something with a thing."""
    found = when_did(moment, query)
    verdict = found.time is not None
    text = f"{'Yes' if verdict else 'No'}: {found.text}"
    return understood(text, found.evidence, verdict=verdict, names=found.names, time=found.time)


def when_did(moment: Moment, query: Query) -> Response:
    """When somebody did something with a thing, last or at a time: anybody, or who is named before the thing."""
    others = 2 if query.relation else 1
    actor, name = query.things[: -others or None], name_of(moment, query.things[-others])
    who = _actors(moment, actor[0]) if actor else None
    mine = [
        entry for entry in _deeds(moment, name, _word(query), span_asked(moment, query))
        if who is None or not who.isdisjoint(entry.participants[1:])
    ]  # fmt: skip
    if not mine:
        by = f" by {listed(sorted(who))}" if who else ""
        return understood(f"Nothing tells that {name} was {DID[query.word]}{by}.")
    told = entry_statements(moment, mine[-1:])
    whom = mine[-1].participants[1:2]
    return understood(joined(told), told, names=whom, time=mine[-1].begin, since=told[-1].since)


def which_did(moment: Moment, query: Query) -> Response:
    """Which things, of a kind or of all, were moved, fell, were picked up ...: at a time, lately, or the last one."""
    span, is_last = span_asked(moment, query), query.kind == "last_done"
    if span is None and not is_last:
        span = TimeSpan(moment.now - LATELY, moment.now, "lately")
    kind, actor = "thing", None
    for asked in query.things:
        if nodes_called(moment, asked):
            kind = asked
        else:
            actor = _actors(moment, asked)
    told = [one for node in nodes_called(moment, kind) for one in doings(moment, node.name, query.word, span)]
    mine = [one for one in told if actor is None or (one.evidence["kind"] in KINDS and not actor.isdisjoint(one.names))]
    ordered = sorted({one.text: one for one in mine}.values(), key=lambda one: one.time or 0.0)
    shown = ordered[-1:] if is_last else ordered
    things = {node.name for node in nodes_called(moment, kind)}
    names = dict.fromkeys(name for one in reversed(shown) for name in _moved_things(one) if name in things)
    nothing = f"Nothing tells that any of them was {DID[query.word]}{'' if span is None else f' {span.words}'}."
    return understood(_ended(_shortened(shown) or nothing, moment, span, shown), shown, names=names)


def any_did(moment: Moment, query: Query) -> Response:
    """Whether any thing was moved, fell, ...: at a time, or lately."""
    found = which_did(moment, query)
    text = f"{'Yes' if found.names else 'No'}: {found.text}"
    return understood(text, found.evidence, verdict=bool(found.names), names=found.names)


def deeds_of(moment: Moment, query: Query) -> Response:
    """What somebody did, or what was done with a thing, at a time or at all."""
    span = span_asked(moment, query)
    actor, thing = _actor_and_thing(moment, query)
    since, until = (None, None) if span is None else (span.begin, span.end)
    wanted = (*KINDS, ACTION) if actor is not None and _is_own(moment, actor) else KINDS
    entries = [
        entry for entry in recall(moment.memory, kind=wanted, since=since, until=until)
        if (thing is None or thing in entry.participants)
        and (actor is None or entry.kind == ACTION or not actor.isdisjoint(entry.participants[1:]))
    ]  # fmt: skip
    told = entry_statements(moment, entries)
    nothing = "Nothing tells of that."
    return understood(_ended(_shortened(told) or nothing, moment, span, told), told)


def _actor_and_thing(moment: Moment, query: Query) -> tuple[set[str] | None, str | None]:
    """Who is meant, and with what: one of the two may be open."""
    actor, thing = None, None
    for asked in query.things:
        if is_robot(asked) or node_of(moment, asked).type in _ACTORS:
            actor = _actors(moment, asked)
        else:
            thing = name_of(moment, asked)
    return actor, thing


def _actors(moment: Moment, asked: str) -> set[str]:
    """Names of the hands or grippers that are meant: those of the robot, or one."""
    if is_robot(asked):
        return {node.name for node in moment.memory.nodes("gripper")}
    return {node_of(moment, asked).name}


def _is_own(moment: Moment, actor: set[str]) -> bool:
    """Whether the robot itself is meant, whose plans tell more."""
    return actor == _actors(moment, ROBOT)


def _moved_things(told: Statement) -> tuple[str, ...]:
    """The things that an event is about: of an action the one that was acted on."""
    return told.names[:1] if told.evidence.get("kind") in KINDS else told.names


def _word(query: Query) -> str:
    """What was done; who put a thing somewhere may have let it fall there."""
    return "put there" if query.relation else query.word


def was_done(moment: Moment, query: Query) -> Response:
    """Whether a thing moved, fell, was picked up ..."""
    name, span = node_of(moment, query.things[0]).name, span_asked(moment, query)
    told = doings(moment, name, query.word, span)
    text = told[-1].text if told else f"Nothing tells that {name} was {DID[query.word]}."
    text = _ended(f"{'Yes' if told else 'No'}: {text}", moment, span, told)
    return understood(text, told[-1:], verdict=bool(told), time=told[-1].time if told else None)


def _deeds(moment: Moment, name: str, word: str, span: TimeSpan | None) -> list[Entry]:
    """The actions on a thing that a word means, in their order."""
    since, until = (None, None) if span is None else (span.begin, span.end)
    entries = recall(moment.memory, kind=_BY_HAND[word], participants=name, since=since, until=until)
    return [entry for entry in entries if entry.participants[:1] == (name,)]


def counted_deeds(moment: Moment, entries: list[Entry]) -> list[Statement]:
    """One sentence for all that somebody did of one kind with a thing, with how often and when last."""
    by: dict[tuple[str, tuple[str, ...]], list[Entry]] = defaultdict(list)
    for entry in entries:
        by[entry.kind, entry.participants].append(entry)
    found = []
    for same in by.values():
        (last,) = entry_statements(moment, same[-1:])
        often = f" It was the last of {len(same)} times." if len(same) > 1 else ""
        evidence = last.evidence | {"times": len(same)}
        found.append(msgspec.structs.replace(last, text=f"{last.text}{often}", evidence=evidence))
    return found


def _shortened(told: list[Statement]) -> str:
    """The sentences; of many the newest, half of them of what was surprising if there is so much, and who else."""
    if len(told) <= _MOST_SENTENCES:
        return joined(told)
    surprising = [one for one in told if one.evidence.get("kind") in SURPRISES][-_MOST_SENTENCES // 2 :]
    others = [one for one in told if one not in surprising][len(surprising) - _MOST_SENTENCES :]
    shown = [one for one in told if one in surprising or one in others]
    left = [one for one in told if one not in shown]
    names = sorted({one.names[0] for one in left if one.names})[:_MOST_SENTENCES]
    return f"{joined(shown)} Before and between, {len(left)} more things happened, with {listed(names)}."


def _ended(text: str, moment: Moment, span: TimeSpan | None, told: list[Statement]) -> str:
    """An answer about the past, with how well that is remembered."""
    return text if span is None else f"{text} {limits_of_memory(moment, span, told)}".strip()
