"""What the timeline tells of a time: the relations that held then, and the last event of a kind."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from dsr.narration.happenings import entry_evidence, entry_statements
from dsr.narration.statements import Basis, Moment, Statement, Subject, ago
from dsr.timeline import EXPLAINED, Entry, query
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE
from dsr.vocabulary.sentences import RELATION_WORDS

_HELD = ("on", "in", "grasping")
_DOINGS: dict[str, tuple[str, ...]] = {
    "pick": (PICK,), "put": (PLACE,), "drop": (RELEASE,), "remove": (EXPLAINED, PICK),
    "move": (PICK, EXPLAINED), "fall": (EXPLAINED, RELEASE), "appear": ("present",), "vanish": ("present",),
}  # fmt: skip
"""Kinds of entries that tell of what was done, by the word of a question."""


def relations_at(moment: Moment, name: str, time: float) -> list[Entry]:
    """The relations of a thing to what it was on, in or held by at `time` (s), as far as the timeline holds them."""
    entries = query(moment.memory, kind=_HELD, participants=name, since=time, until=time)
    return [entry for entry in entries if _is_of(entry, name) and entry.begin <= time < entry.last]


def contents_at(moment: Moment, name: str, kinds: Collection[str], time: float) -> list[Entry]:
    """The relations of these kinds that things had to `name` at `time` (s)."""
    entries = query(moment.memory, kind=kinds, participants=name, since=time, until=time)
    return [entry for entry in entries if entry.participants[1:] == (name,) and entry.begin <= time < entry.last]


def told_at(moment: Moment, entries: Iterable[Entry], time: float) -> list[Statement]:
    """Relations of the past as sentences. Nobody can tell of each whether it was seen: they are beliefs of then."""
    found = []
    for entry in entries:
        words = RELATION_WORDS[entry.kind]
        source, destination = entry.participants
        verb = words.holds.replace("is ", "was ").replace("rests", "rested").replace("holds", "held")
        text = f"{ago(moment.now - time)}, by the robot's belief of then, {source} {verb} {destination}."
        found.append(
            Statement(
                text=text, subject=Subject.HAPPENED, basis=Basis.BELIEVED, names=entry.participants, time=time,
                confidence=entry.confidence, evidence=entry_evidence(entry),
            )
        )
    return found


def doings(moment: Moment, name: str, word: str) -> list[Statement]:
    """What was done with a thing, the newest last: events of the kinds that the word of a question means."""
    entries = query(moment.memory, kind=_DOINGS[word], participants=name)
    wanted = [entry for entry in entries if word != "vanish" or entry.end is not None]
    told = entry_statements(moment, wanted)
    if word in ("appear", "vanish"):
        return [one for one in told if one.claims[0].relation == ("appeared" if word == "appear" else "disappeared")]
    if word == "fall":
        return [one for one in told if one.evidence["kind"] != EXPLAINED or "fell" in one.text]
    return told


def _is_of(entry: Entry, name: str) -> bool:
    """Whether a relation tells where the thing is, rather than what is in or on it."""
    return entry.participants[1 if entry.kind == "grasping" else 0] == name
