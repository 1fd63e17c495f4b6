"""Actions of hands and grippers as they are inferred: their names, and the patterns that texts tell them by.

They are events of the kinds `Pick`, `Place` and `Release` (Sallami et al., Sec. IV-A), whose participants are the thing
and who did it. The actions of a plan are something else: see `dsr.vocabulary.intentions`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import msgspec

from dsr.clock import is_time
from dsr.errors import GoalError, SchemaError, WireError, suggest
from dsr.graph.elements import Node
from dsr.graph.schema import is_name
from dsr.network.decoding import decoded

PICK, PLACE, RELEASE = "Pick", "Place", "Release"
KINDS = (PICK, PLACE, RELEASE)
"""Taken from where it lay; put down so that it lies; let go of so that it falls, or is gone."""
UNKNOWN = "unknown"
"""Name of the actor where nobody can tell who acted."""

DEEDS = "deeds"
"""Attribute of a thing's node: what was done with it last, by the belief, as JSON. See `deeds_of`."""
KEPT = 2
"""count of deeds that are kept of a thing: it was taken up before it was put down"""

_PATTERN = re.compile(r"\s*(\w+)\s*(?:\(\s*([\w.\-]+)\s*(?:,\s*([\w.\-]+)\s*)?\)\s*)?")


class Action(NamedTuple):
    """An action on a thing."""

    time: float
    """Time of the action, s"""
    kind: str
    """Kind of the action, one of `KINDS`."""
    thing: str
    by: str = UNKNOWN
    """Node of a hand or gripper, or `UNKNOWN`."""

    def __str__(self) -> str:
        return f"{self.kind}({self.thing})" if self.by == UNKNOWN else f"{self.kind}({self.thing}, {self.by})"


class Deed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was done with a thing, by the belief."""

    kind: str
    """One of `KINDS`."""
    time: float
    """When it was done, s"""
    by: str
    """Node of a hand or gripper, or `UNKNOWN`."""
    probability: Annotated[float, msgspec.Meta(ge=0, le=1)]
    """1, that it is so"""


_Deeds = Annotated[tuple[Deed, ...], msgspec.Meta(max_length=KEPT)]
_decoder: msgspec.json.Decoder[tuple[Deed, ...]] = msgspec.json.Decoder(_Deeds)


@dataclass(frozen=True)
class Pattern:
    """A pattern of actions: `Pick(cup)`, `Pick(cup, human_hand_0)`, or `Release` for one of anything."""

    kind: str
    thing: str | None = None
    by: str | None = None

    def fits(self, action: Action) -> bool:
        """Whether an action is meant; what the pattern leaves open does not matter."""
        return (
            action.kind == self.kind
            and self.thing in (None, action.thing)
            and self.by in (None, action.by)
        )  # fmt: skip


def parse_pattern(text: str) -> Pattern:
    """Read a pattern from its text. Raises `GoalError`, which points at the fault."""
    match = _PATTERN.fullmatch(text)
    if match is None:
        raise GoalError(text, 0, "expected an action such as Pick(cup), Pick(cup, human_hand_0) or Release")
    if match[1] not in KINDS:
        raise GoalError(text, match.start(1), f"unknown action {match[1]!r}; {suggest(match[1], KINDS)}")
    return Pattern(match[1], match[2], match[3])


def read_action(event: Node) -> Action | None:
    """The action that an event tells; None for other events."""
    kind, time = event.get("kind"), event.get("time")
    thing, _, by = str(event.get("participants", "")).partition(",")
    if kind not in KINDS or not is_time(time) or not thing:
        return None
    return Action(time, kind, thing.strip(), by.strip() or UNKNOWN)


def encoded(deeds: Sequence[Deed]) -> str:
    """Encode deeds, oldest first, for the attribute `DEEDS`."""
    return msgspec.json.encode(deeds).decode()


def deeds_of(node: Node) -> tuple[Deed, ...]:
    """What the belief says that was done with a thing lately, oldest first. Raises `SchemaError` if that is no deed."""
    try:
        found = decoded(str(node.get(DEEDS, "[]")), DEEDS, _decoder.decode)
    except WireError as error:
        raise SchemaError(f"{node}: {error}") from error
    if any(deed.kind not in KINDS or not is_time(deed.time) or not is_name(deed.by) for deed in found):
        raise SchemaError(f"{node}: {DEEDS} has a deed without time or actor, or none of {', '.join(KINDS)}")
    return found
