"""Tells what happened: entries of the timeline as sentences, those of what nobody saw marked as belief."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from dsr.narration.doings import goal_words
from dsr.narration.places import GRIPPER
from dsr.narration.statements import Basis, Moment, StatedClaim, Statement, Subject, seen_since, sentence_begin
from dsr.timeline import (
    ACTION,
    AGENT,
    EVENT,
    EXPLAINED,
    FORBIDDEN,
    INTENTION,
    PRESENT,
    SURPRISING,
    Entry,
    recall,
)
from dsr.vocabulary.calibration import CALIBRATED
from dsr.vocabulary.intentions import (
    DONE,
    EXECUTING,
    FAILED,
    FULFILLED,
    GIVEN_UP,
    HALTED,
    PLANNING,
    RUNNING,
    WAITING,
    WANTED,
    describe_action,
)
from dsr.vocabulary.observed_actions import KINDS as OBSERVED
from dsr.vocabulary.observed_actions import PICK, PLACE, UNKNOWN
from dsr.vocabulary.perceived import MOST_SILENT
from dsr.vocabulary.sentences import RELATION_WORDS, TOUCHING, explained_sentence

_ACTION_WORDS = {RUNNING: "began to act", DONE: "has done", FAILED: "failed", HALTED: "broke off"}
_GOAL_WORDS = {
    WANTED: "came to want", PLANNING: "planned for", EXECUTING: "began to act for", WAITING: "waited with",
    **dict.fromkeys(FULFILLED, "reached"), **dict.fromkeys(GIVEN_UP, "gave up"),
}  # fmt: skip
_OBSERVED_WORDS = {PICK: "picked {} up", PLACE: "put {} down"}


class _Told(NamedTuple):
    """An event before it is a statement."""

    time: float
    clause: str
    """A sentence without time and full stop."""
    claim: StatedClaim | None
    is_own: bool = False
    """Whether it is about the robot's mind."""


def happening_statements(moment: Moment, since: float, until: float | None = None) -> list[Statement]:
    """Tell the events between `since` and `until` (s; now if None), in their order, as far as the timeline holds them.

    Agents at work and plans that did not begin are left out.
    """
    now = moment.now
    end = now if until is None else until
    entries = recall(moment.memory, since=since, until=end)
    return [told for told in entry_statements(moment, entries) if since <= (told.time or 0.0) <= end]


def entry_statements(moment: Moment, entries: Iterable[Entry]) -> list[Statement]:
    """Tell all that these entries hold, in the order of time.

    That a thing rests on what it is in goes without saying.
    """
    told_of = list(entries)
    inside = {entry.participants for entry in told_of if entry.kind == "in"}
    chosen = [entry for entry in told_of if not (entry.kind == "on" and entry.participants in inside)]
    found = [statement_of(moment, entry, told) for entry in chosen for told in _told(entry)]
    return sorted(found, key=lambda statement: statement.time or 0.0)


def entry_evidence(entry: Entry) -> dict[str, object]:
    """An entry of the timeline as plain data."""
    known = {"entry": entry.name, "kind": entry.kind, "begin": entry.begin, "end": entry.end, "source": entry.source}
    more = {"text": entry.text, "summary": entry.details.get("summary", "")}
    return known | {name: value for name, value in more.items() if value}


def statement_of(moment: Moment, entry: Entry, told: _Told) -> Statement:
    """One event as a statement."""
    unseen_from = _unseen_from(moment, entry, told.time)
    when = moment.when(told.time)
    when = sentence_begin(when if unseen_from is None else f"between {moment.when(unseen_from)} and {when}, unseen")
    if told.is_own:
        basis, text = Basis.OWN, f"{when}, {told.clause}."
    elif entry.confidence < 1.0:
        basis, text = Basis.BELIEVED, f"{when}, probably ({entry.confidence:.2f}), {told.clause}."
    elif _was_seen(moment, entry, told.time):
        basis, text = Basis.PERCEIVED, f"{when}, {told.clause}."
    else:
        basis, text = Basis.BELIEVED, f"{when}, it is believed, {told.clause}."
    return Statement(
        text=text, subject=Subject.HAPPENED, basis=basis, names=entry.participants,
        claims=() if told.claim is None else (told.claim,), time=told.time, since=unseen_from,
        confidence=entry.confidence, evidence=entry_evidence(entry),
    )  # fmt: skip


def _unseen_from(moment: Moment, entry: Entry, time: float) -> float | None:
    """Since when (s) the thing of an inferred action was unseen at its `time` (s); None if it was seen then or later.

    A hand may have acted at any time since then: the inference only tells when that was noticed. A gripper is felt.
    """
    if entry.kind not in OBSERVED or not entry.participants:
        return None
    node, *by = (moment.memory.get_node(name) for name in entry.participants)
    if any(actor is not None and actor.type == GRIPPER for actor in by):
        return None
    last = None if node is None else node.get("last_seen")
    return last if isinstance(last, float) and last < time - MOST_SILENT else None


def _was_seen(moment: Moment, entry: Entry, time: float) -> bool:
    """Whether all things of an entry have been seen from before `time` (s) until now, or a gripper felt what happened.

    A thing that is seen again may have moved before. What a hand touches is worked out from where its fingers are: no
    sensor feels it.
    """
    if entry.kind == "grasping":
        return entry.source == GRIPPER
    now = moment.now
    nodes = [moment.memory.get_node(name) for name in entry.participants]
    since = [None if node is None else seen_since(node, now) for node in nodes]
    before = 0.0 if entry.kind == PRESENT else MOST_SILENT
    return all(begin is not None and begin <= time - before for begin in since)


def _told(entry: Entry) -> Iterator[_Told]:
    if entry.type == EVENT:
        yield from _event(entry)
    elif entry.kind in RELATION_WORDS and len(entry.participants) == 2:
        yield from _relation(entry)
    elif entry.kind == PRESENT and entry.participants:
        name = entry.participants[:1]
        yield _Told(entry.begin, f"{name[0]} appeared", StatedClaim("appeared", name))
        if entry.end is not None:
            yield _Told(entry.end, f"{name[0]} disappeared", StatedClaim("disappeared", name))
    elif entry.kind == SURPRISING and entry.participants:
        name = entry.participants[:1]
        yield _Told(entry.begin, entry.text or f"{name[0]} was surprising", None, is_own=True)
    elif entry.kind == FORBIDDEN:
        yield _Told(entry.begin, f"motion was forbidden: {entry.text}", None, is_own=True)
        if entry.end is not None:
            yield _Told(entry.end, f"motion was {entry.outcome or 'allowed again'}", None, is_own=True)
    elif entry.kind not in (AGENT, INTENTION, ACTION):
        what = entry.text or f"{entry.kind} {', '.join(entry.participants)}"
        yield _Told(entry.begin, f'{entry.source or "somebody"} told that "{what}" began', None, is_own=True)
        if entry.end is not None:
            yield _Told(entry.end, f'{entry.source or "somebody"} told that "{what}" ended', None, is_own=True)


def _relation(entry: Entry) -> Iterator[_Told]:
    is_touch = entry.kind == "grasping" and entry.source != GRIPPER  # of hands, which may only pass by
    words, kind = (TOUCHING, "touching") if is_touch else (RELATION_WORDS[entry.kind], entry.kind)
    source, destination = entry.participants
    began = StatedClaim(f"began {kind}", entry.participants)
    yield _Told(entry.begin, f"{source} {words.began} {destination}", began)
    if entry.end is not None:
        ended = StatedClaim(f"ended {kind}", entry.participants)
        yield _Told(entry.end, f"{source} {words.ended} {destination}", ended)


def _event(entry: Entry) -> Iterator[_Told]:
    status = str(entry.details.get("status", ""))
    if entry.kind in OBSERVED and entry.participants:
        thing, *by = entry.participants
        who = by[0] if by and by[0] != UNKNOWN else "somebody"
        clause = f"{who} {_OBSERVED_WORDS.get(entry.kind, 'let go of {}').format(thing)}"
        yield _Told(entry.begin, clause, StatedClaim(entry.kind, entry.participants))
    elif entry.kind == EXPLAINED:
        sentence = explained_sentence({**entry.details, "explanation": entry.details.get("explanation", entry.text)})
        yield _Told(entry.begin, f"the robot concluded that {sentence}", None, is_own=True)
    elif entry.kind == ACTION and status in _ACTION_WORDS:
        why = entry.details.get("explanation", "")
        because = f": {why}" if why else ""
        clause = f"the robot {_ACTION_WORDS[status]}: {describe_action(entry.details)}{because}"
        yield _Told(entry.begin, clause, None, is_own=True)
    elif entry.kind == INTENTION:
        why = entry.details.get("explanation", "")
        goal = goal_words(str(entry.details.get("goal", "")))
        done = _GOAL_WORDS.get(status, "noted")
        because = f": {why}" if why and status in (WAITING, *GIVEN_UP) else ""
        clause = f"the robot {done} the goal {goal}{because}"
        yield _Told(entry.begin, clause, None, is_own=True)
    elif entry.kind == CALIBRATED:
        yield _Told(entry.begin, f"the robot concluded that {entry.text}", None, is_own=True)
    elif entry.kind != ACTION:
        what = entry.text or f"{entry.kind} {', '.join(entry.participants)}"
        yield _Told(entry.begin, f'{entry.source or "somebody"} told: "{what}"', None, is_own=True)
