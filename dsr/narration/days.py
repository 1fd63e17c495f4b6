"""The account of a time past: where each thing was, who moved it, and what was surprising."""

from __future__ import annotations

from dsr.narration.calendar import TimeSpan
from dsr.narration.deeds import counted_deeds
from dsr.narration.happenings import entry_statements
from dsr.narration.past import relations_during, told_during, within
from dsr.narration.statements import Moment, Statement
from dsr.timeline import SURPRISES, recall
from dsr.vocabulary.observed_actions import KINDS

_PLACES = ("on", "in")


def day_account(moment: Moment, span: TimeSpan) -> list[Statement]:
    """Tell a time in sentences: of each thing its places, the longest first, and who moved it; then the surprises.

    Args:
        moment: the graph, and now.
        span: of which to tell: a day, or any other time.
    """
    entries = recall(moment.memory, kind=(*_PLACES, *KINDS, *SURPRISES), since=span.begin, until=span.end)
    things = sorted({entry.participants[0] for entry in entries if entry.kind not in SURPRISES and entry.participants})
    told: list[Statement] = []
    for name in things:
        told += told_during(moment, relations_during(moment, name, span), span)
        told += counted_deeds(moment, [entry for entry in entries if _is_deed_on(entry.kind, entry.participants, name)])
    surprising = [entry for entry in entries if entry.kind in SURPRISES]
    return told + within(entry_statements(moment, surprising), span)


def _is_deed_on(kind: str, participants: tuple[str, ...], name: str) -> bool:
    return kind in KINDS and participants[:1] == (name,)
