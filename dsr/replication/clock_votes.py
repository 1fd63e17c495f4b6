"""Votes of the agents' clocks about each other: one vote an agent, and no verdict from a single vote.

A clock that is ahead is seen at once, since a message cannot come from the future. One that is behind cannot be told
from a message that was long under way. So each replica says which others it sees ahead of itself. Of two clocks nobody
can tell which one is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from dsr.network.keys import agent_of

MOST_NAMED = 4
"""Agents that a text names."""


class Voice(NamedTuple):
    """The newest statement of a peer's replica about clocks."""

    rid: str
    heard_at: float
    """s, on the monotonic clock."""
    sees_us_ahead: bool
    is_ahead: bool
    """Whether we see its clock ahead of ours."""


@dataclass(frozen=True)
class ClockVerdict:
    """The agreement of this process's clock with those of other agents."""

    agents: int = 0
    """Number of other agents that were heard of lately."""
    slower: tuple[str, ...] = ()
    """Agents whose clock is behind ours, as they say."""
    faster: tuple[str, ...] = ()
    """Agents whose clock is ahead of ours, as we see."""

    @property
    def is_ahead(self) -> bool:
        """Whether most of the others, and at least two, are behind: then nothing must be written."""
        return self._most(self.slower)

    @property
    def is_behind(self) -> bool:
        """Whether most of the others, and at least two, are ahead."""
        return self._most(self.faster)

    @property
    def kind(self) -> Literal["", "ahead", "behind", "apart"]:
        """In one word: `apart` if clocks differ and nobody can tell which one is wrong; empty if all agree."""
        if self.is_ahead:
            return "ahead"
        return "behind" if self.is_behind else "apart" if self.slower or self.faster else ""

    def _most(self, agents: tuple[str, ...]) -> bool:
        return len(agents) >= 2 and 2 * len(agents) > self.agents

    def __str__(self) -> str:
        """For people; empty if all clocks agree."""
        if self.kind == "ahead":
            return f"this clock is ahead of most others ({_named(self.slower)})"
        if self.kind == "behind":
            return f"this clock is behind most others ({_named(self.faster)})"
        parts = [f"the clock of {_named(self.slower)} is behind this one"] if self.slower else []
        parts += [f"the clock of {_named(self.faster)} is ahead of this one"] if self.faster else []
        return f"{', '.join(parts)}, or this one is wrong" if parts else ""


def verdict(voices: Iterable[Voice]) -> ClockVerdict:
    """The verdict of what was heard lately; of an agent with several replicas only the newest word counts."""
    newest: dict[str, Voice] = {}
    for voice in sorted(voices, key=lambda voice: voice.heard_at):
        newest[agent_of(voice.rid) or voice.rid] = voice
    slower = sorted(agent for agent, voice in newest.items() if voice.sees_us_ahead)
    faster = sorted(agent for agent, voice in newest.items() if voice.is_ahead)
    return ClockVerdict(len(newest), tuple(slower), tuple(faster))


def _named(agents: tuple[str, ...]) -> str:
    rest = f" and {len(agents) - MOST_NAMED} more" if len(agents) > MOST_NAMED else ""
    return ", ".join(agents[:MOST_NAMED]) + rest
