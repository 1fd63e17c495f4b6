"""Answers what happened, who did it, and what was surprising: lately, or at a time of which summaries tell."""

from __future__ import annotations

from collections import defaultdict

import msgspec

from dsr.narration.account import LATELY
from dsr.narration.answer import Response, joined, understood
from dsr.narration.asked import span_asked
from dsr.narration.calendar import TimeSpan
from dsr.narration.happenings import entry_statements, happening_statements
from dsr.narration.naming import is_robot, name_of, node_of
from dsr.narration.past import doings, limits_of_memory, within
from dsr.narration.places import surprise_of
from dsr.narration.questions import Query
from dsr.narration.retrospect import DID, explanations_of
from dsr.narration.statements import Moment, Statement
from dsr.timeline import SURPRISES, Entry, recall
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, UNKNOWN
from dsr.vocabulary.sentences import listed

_BY_HAND = {
    "pick": (PICK,), "put": (PLACE,), "drop": (RELEASE,), "move": (PICK, PLACE), "remove": (PICK,),
    "hold": (PICK,), "held": (PICK,),
}  # fmt: skip
"""Inferred actions that tell who did something, by the word of a question."""
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
    mine = _deeds(moment, name, query.word, span)
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
