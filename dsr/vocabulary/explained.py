"""What happened by an explanation: changes with typed fields, which travel as an attribute of the event `explained`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from dsr.errors import WireError
from dsr.network.decoding import decoded

# Kinds of changes. Programs tell changes by these words, and so do recordings: they never change.
CAMERA_MOVED = "camera_moved"
"""Not the objects but a camera moved. The calibrator looks into that."""
MOVED = "moved_alone"
TURNED = "turned"
WITH_SUPPORTS = "moved_with_supports"
"""An object moved, and those of the second group beneath it moved along."""
WITH_CONTENTS = "moved_with_contents"
"""An object moved, and those of the second group in or on it moved along."""
SWAPPED = "swapped"
"""Each of a pair is where the other one was."""
PUT_ON = "put_on"
"""The first of the group stands on the others now."""
RELATION_ENDED = "relation_ended"
"""The first of the group does not stand on the others any more."""
UNDER = "put_back_under"
"""The unseen objects of the first group, the lowest first, are beneath the object of the second group."""
PLACED_UNDER = "placed_under"
"""The unseen object of the first group was brought beneath the object of the second group."""
HELD = "held"
"""Something unknown holds an object in the air."""
HELD_TOO = "held_"
"""Before the kind of a change of an object that something unknown holds as well."""
FELL = "fell"
REMOVED = "removed"
"""An object was taken away unseen."""
TAKEN_ALONG = "taken_along"
"""A hand took an object with it; the second group names the hand."""
APPEARED = "appeared"
"""An object is there that was believed to be gone, or nowhere."""
FALSE_PERCEPT = "false_percept"
"""What was seen of an object is false: the belief stays."""
NOTHING_CHANGED = "nothing_changed"
"""The belief stays as it is, and the percepts are false."""
KINDS = (CAMERA_MOVED, MOVED, TURNED, WITH_SUPPORTS, WITH_CONTENTS, SWAPPED, PUT_ON, RELATION_ENDED, UNDER,
         PLACED_UNDER, HELD, FELL, REMOVED, TAKEN_ALONG, APPEARED, FALSE_PERCEPT, NOTHING_CHANGED)  # fmt: skip
"""All kinds but those with `HELD_TOO` before them."""
ATTRIBUTE = "changes"
"""Of the event: the changes as JSON, for `changes_of`."""

_WRITTEN = re.compile(r"\b(\w++)\(([^()]*)\)")  # begins at words only, so that no text takes long


class ExplainedChange(msgspec.Struct, frozen=True, array_like=True):
    """One thing that happened, such as `moved_with_supports(cube_3; cube_4)`."""

    kind: str
    """A word; the table in docs/explanation/explanations.md lists all."""
    groups: tuple[tuple[str, ...], ...] = ()
    """Names of objects, in groups whose meaning the kind tells. Most kinds have the object that was seen first."""

    def __str__(self) -> str:
        return f"{self.kind}({'; '.join(', '.join(group) for group in self.groups)})"


_decoder = msgspec.json.Decoder(tuple[ExplainedChange, ...])


def text_of(changes: Iterable[ExplainedChange]) -> str:
    """The changes in a line, joined by `&`, as events and recordings hold them."""
    return " & ".join(map(str, changes))


def encoded(changes: tuple[ExplainedChange, ...]) -> str:
    """JSON of the changes, for the attribute `changes`."""
    return msgspec.json.encode(changes).decode()


def changes_of(attributes: Mapping[str, Any], text: str = "") -> tuple[ExplainedChange, ...]:
    """The changes that an event `explained` tells; none if it is malformed.

    Args:
        attributes: of the event.
        text: of the event. Recordings from before there was the attribute `changes` have only that.
    """
    written = attributes.get(ATTRIBUTE)
    if not isinstance(written, str):
        return tuple(_as_written(kind, names) for kind, names in _WRITTEN.findall(text))
    try:
        return decoded(written, "changes", _decoder.decode)
    except WireError:
        return ()


def _as_written(kind: str, names: str) -> ExplainedChange:
    return ExplainedChange(kind, tuple(tuple(group.split(", ")) for group in names.split("; ") if group))
