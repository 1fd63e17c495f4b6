"""What happened by an explanation: changes with typed fields, which travel as an attribute of the event `explained`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

CAMERA_MOVED = "camera_moved"
"""Kind of a change: not the objects but a camera moved. The calibrator looks into that."""
REMOVED = "removed"
"""Kind of a change: an object was taken away unseen."""
TAKEN_ALONG = "taken_along"
"""Kind of a change: a hand took an object with it; the second group names the hand."""
NOTHING_CHANGED = "nothing_changed"
"""Kind of a change: the belief stays as it is, and the percepts are false."""
ATTRIBUTE = "changes"
"""Of the event: the changes as JSON, for `changes_of`."""

_WRITTEN = re.compile(r"(\w+)\(([^()]*)\)")


class ExplainedChange(msgspec.Struct, frozen=True, array_like=True):
    """One thing that happened, such as `moved_with_supports(cube_3; cube_4)`."""

    kind: str
    """A word; the table in docs/explanation/explanations.md lists all."""
    groups: tuple[tuple[str, ...], ...] = ()
    """Names of objects, in groups whose meaning the kind tells. Most kinds have the object that was seen first."""

    def __str__(self) -> str:
        return f"{self.kind}({'; '.join(', '.join(group) for group in self.groups)})"


def text_of(changes: Iterable[ExplainedChange]) -> str:
    """The changes in a line, joined by `&`, for people."""
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
        return msgspec.json.decode(written, type=tuple[ExplainedChange, ...])
    except msgspec.DecodeError:
        return ()


def _as_written(kind: str, names: str) -> ExplainedChange:
    return ExplainedChange(kind, tuple(tuple(group.split(", ")) for group in names.split("; ") if group))
