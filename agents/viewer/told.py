"""Writes the account of the memory in words, the same text as `dsr tell`, as a page."""

from __future__ import annotations

import math

import rerun as rr

from agents.viewer.proposals import ProposalsWatch, proposals_text
from agents.viewer.texts import markdown
from dsr import Memory
from dsr.narration import Basis, Moment, account, chapters
from dsr.vocabulary.proposed_acts import ProposedAct

PAGE = "mind/told"
_PERIOD = 1.0  # s between two pages: the times in the sentences run on, and nobody reads faster
_LONGEST = 400  # characters of a sentence


class ToldView:
    """Logs the page about once a second."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._due = -math.inf
        self._proposals = ProposalsWatch()

    def draw(self, memory: Memory, now: float) -> None:
        """Log what is told at time `now` (s), unless that was done within the last second."""
        if self._due - _PERIOD <= now < self._due:  # a replay may go back
            return
        self._due = now + _PERIOD
        page = told_page(Moment(memory, now), self._proposals.waiting(memory, now))
        self._recording.log(PAGE, rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN))


def told_page(moment: Moment, proposed: list[ProposedAct]) -> str:
    """Markdown: the acts that wait for a person, then sentences below their titles, those of beliefs in italics."""
    parts = proposals_text(proposed, moment.now)
    for title, statements in chapters(account(moment)):
        parts.append(f"**{title}**")
        for statement in statements:
            mark = "*" if statement.basis is Basis.BELIEVED else ""
            parts.append(f"{mark}{markdown(statement.text, _LONGEST)}{mark}")
    return "\n\n".join(parts) or "*Nothing is known.*"
