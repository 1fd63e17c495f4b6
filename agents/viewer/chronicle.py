"""The timeline: situations as bars over time, a lane for each kind and thing, and one for all actions."""

from __future__ import annotations

from collections.abc import Iterable

import rerun as rr

from agents.viewer.elapsed import Elapsed
from agents.viewer.texts import drawable
from dsr import Change, Memory
from dsr.timeline import ACTION, AGENT, RELATIONS, SITUATION, Entry, read_entry

ENTITY = "timeline"
_MOST_LANES = 60
_LONGEST = 40
Lane = tuple[str, str]
"""(kind, first participant)"""


class ChronicleView:
    """Logs the begins and ends of situations, at their own times.

    Args:
        recording: where to.
        elapsed: sets its time lines.
    """

    def __init__(self, recording: rr.RecordingStream, elapsed: Elapsed) -> None:
        self._recording = recording
        self._elapsed = elapsed
        self._lanes: set[Lane] = set()
        self._shown: dict[str, tuple[Lane, str, float, float | None]] = {}

    def draw(self, changes: Iterable[Change], memory: Memory, now: float) -> None:
        """Log the situations that changed; then go back to time `now` (s)."""
        names = {change.name for change in changes if change.element == "node" and change.type == SITUATION}
        for name in sorted(names):
            node = memory.get_node(name)
            entry = None if node is None else read_entry(node)
            if entry is None:
                self._shown.pop(name, None)
            elif entry.kind != AGENT:  # the rates of agents are shown elsewhere
                self._draw(entry)
        if names:
            self._elapsed.set(now)

    def _draw(self, entry: Entry) -> None:
        subject = "arm" if entry.kind == ACTION else "".join(entry.participants[:1])
        lane, label = (entry.kind, subject), _label(entry)
        before = self._shown.get(entry.name)
        if before is None and (len(self._lanes) >= _MOST_LANES and lane not in self._lanes):
            return
        self._lanes.add(lane)
        self._shown[entry.name] = (lane, label, entry.begin, entry.end)
        if before is None:
            self._log(lane, entry.begin, label)
        if entry.end is not None and (before is None or before[3] != entry.end):
            self._log(lane, entry.end, self._others(lane, entry))
        elif entry.end is None and before is not None and before[3] is not None:
            self._log(lane, before[3], label)

    def _others(self, lane: Lane, entry: Entry) -> str:
        """What else lasts in that lane when an entry ends; empty for nothing."""
        found = [
            label
            for name, (other, label, begin, end) in self._shown.items()
            if name != entry.name and other == lane and begin <= entry.last and (end is None or end > entry.last)
        ]
        return ", ".join(found)

    def _log(self, lane: Lane, time: float, state: str) -> None:
        kind, subject = (rr.escape_entity_path_part(part or "?") for part in lane)
        self._elapsed.set(time)
        self._recording.log(f"{ENTITY}/{kind}/{subject}", rr.StateChange(state=state))


def _label(entry: Entry) -> str:
    """What stands on a bar."""
    if entry.kind in RELATIONS or not entry.text:
        return drawable(", ".join(entry.participants[1:]) or entry.kind, _LONGEST)
    return drawable(entry.text, _LONGEST)
