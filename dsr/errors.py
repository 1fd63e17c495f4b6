"""Every error that `dsr` raises, in one tree.

    DsrError
    ├── SchemaError             a name, type or value that the schema does not allow
    │   └── RegistrationError   a name that cannot be registered so (a ConfigError, too)
    ├── GraphError              the graph does not hold what was asked for
    │   ├── NoRoomError         no stamp is left above that of an attribute's value
    │   ├── NodeNotFoundError
    │   ├── NodeTypeError       a node keeps the type under which it was made
    │   ├── EdgeNotFoundError
    │   ├── WorldNotFoundError
    │   └── PartNotFoundError   no part of this name is listed
    ├── PartError               a part of the graph is not held here, or cannot be made
    ├── WorldError              a world cannot be made, followed or deleted
    ├── TransformError          a frame chain cannot be evaluated
    │   ├── NoPathError
    │   ├── ExtrapolationError
    │   └── CycleError          frames hang below one another in a circle, or would
    ├── MeshError               vertices and triangles of which no mesh can be made
    │   └── MeshNotFoundError   nobody within reach has the mesh
    ├── ImaginationError        what was to be imagined cannot be, by physics or for want of room
    ├── WireError               bytes that are no valid message (the peer's fault)
    ├── TransportError          the network refuses what was asked (no such endpoint, closed session)
    │   └── ListenError         the endpoint to listen on cannot be had (port in use)
    ├── ClockDriftError         this process's clock is too far from its peers' to write
    ├── ConfigError             a wrong file or option: says which file, line and what was expected
    │   └── GoalError           a text that is no goal: shows the place
    └── AgentError              an agent broke its declaration or life cycle
        └── UndeclaredError     an agent writes what it does not declare (a ConfigError, too)
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from heapq import nsmallest


class DsrError(Exception):
    """Root of all errors raised by this project."""


class SchemaError(DsrError):
    """A name, type or value that the schema does not allow."""


class GraphError(DsrError):
    """The graph does not have the requested element or value."""


class NodeNotFoundError(GraphError):
    """No visible node has this name."""


class NodeTypeError(GraphError):
    """A node cannot be added under another type: it keeps the one under which it was made."""

    def __init__(self, name: str, present: str, wanted: str) -> None:
        super().__init__(
            f"node {name!r} is a {present!r}, not a {wanted!r}; remove it first, or write attributes with update_node"
        )


class EdgeNotFoundError(GraphError):
    """No visible edge has this source, destination and type."""


class NoRoomError(GraphError):
    """An attribute's value has the greatest stamp that there is: its element must be made anew."""

    def __init__(self, key: str | tuple[str, str, str], attribute: str) -> None:
        super().__init__(f"{attribute!r} of {key!r} has the greatest stamp that there is: it cannot be overwritten")
        self.key = key
        self.attribute = attribute


class WorldNotFoundError(GraphError):
    """No world has this name, or nobody holds its content any more."""


class PartNotFoundError(GraphError):
    """No part of the graph has this name."""


class PartError(DsrError):
    """A part of the graph is not held here, or cannot be made."""


class WorldError(DsrError):
    """A world cannot be made, followed or deleted."""


class ImaginationError(DsrError):
    """A scene cannot be imagined: physics does not allow it, or there is no room."""


class TransformError(DsrError):
    """A frame chain cannot be evaluated."""


class NoPathError(TransformError):
    """The two frames are not connected by geometric edges."""


class ExtrapolationError(TransformError):
    """The time asked for lies too far outside the recorded samples."""


class CycleError(TransformError):
    """Frames hang below one another in a circle, or would with the edge that was to be written."""


class MeshError(DsrError):
    """Vertices and triangles of which no mesh can be made."""


class MeshNotFoundError(MeshError):
    """Nobody within reach has the mesh with this hash."""


class WireError(DsrError):
    """Bytes from the network that are no valid message."""


class TransportError(DsrError):
    """The network refuses a request."""


class ListenError(TransportError):
    """The endpoint to be reached at cannot be had: most often, the port is in use."""


class ClockDriftError(DsrError):
    """This process's clock is too far from its peers' clocks to write."""


class ConfigError(DsrError):
    """A configuration, system or scenario that cannot be used."""

    def __init__(self, message: str, *, file: str | None = None, line: int | None = None) -> None:
        place = "" if file is None else f"{file}: " if line is None else f"{file}:{line}: "
        super().__init__(place + message)


class GoalError(ConfigError):
    """A text that is no goal. The message shows the text with a caret below `column`, and says what was expected."""

    def __init__(self, text: str, column: int, message: str) -> None:
        begin = max(0, column - _SHOWN // 2)
        part = text[begin : begin + _SHOWN]
        super().__init__(f"{part}\n{' ' * (column - begin)}^\n{message}")
        self.column = column
        """Of the first character that is wrong, from 0."""
        self.reason = message
        """What is wrong with it, without the text."""


class AgentError(DsrError):
    """An agent broke its declaration or its life cycle."""


class UndeclaredError(AgentError, ConfigError):
    """An agent writes what its class does not declare; to start it again does not help."""


class RegistrationError(SchemaError, ConfigError):
    """A name that cannot be registered, or not with this meaning; to try again does not help."""


_SHOWN = 100
"""Characters of a long text that an error shows around the place."""
_MOST_COMPARED = 500
"""Names that are worth a search for the closest: with 10000, an error would cost 0.1 s."""
_LONGER = 3
"""Times the length of the longest valid name, from which a name is a misspelling of none: too little of it is alike."""
_NUMBER = re.compile(r"[0-9]+")


def closest(name: str, valid: Iterable[str]) -> str:
    """The valid name of which `name` may be a misspelling; empty if there is none, or no telling which.

    A number is no misspelling of another number: `cube_99` is not `cube_9`, nor are `cube_3` and `cube_4` alike.
    """
    names = sorted(valid)
    if len(names) > _MOST_COMPARED or len(name) > _LONGER * max(map(len, names), default=0):
        return ""
    numbers, wording = _numbers(name), _wording(name)
    alike = [other for other in names if _wording(other) == wording]  # only the numbers may be wrong
    possible = [other for other in alike or names if not numbers or _numbers(other) in ((), numbers)]
    found = next(iter(difflib.get_close_matches(name, possible, n=1)), "")
    if found and _numbers(found) != numbers and sum(_wording(other) == _wording(found) for other in possible) > 1:
        return ""  # the number is what is missing, and more than one would do
    return found


def suggest(name: str, valid: Iterable[str], most: int = 12) -> str:
    """End of an error message: the closest valid name, or the valid ones (at most `most`), first those alike.

    Of very many names, the first ones are listed.
    """
    names, wording = list(valid), _wording(name)
    if len(names) > _MOST_COMPARED:
        shown = nsmallest(most, names)
    elif found := closest(name, names):
        return f"did you mean {found!r}?"
    else:
        shown = nsmallest(most, names, key=lambda other: (_wording(other) != wording, other))
    listed = ", ".join(shown)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"valid: {listed}{more}" if names else "none is known"


def _numbers(name: str) -> tuple[str, ...]:
    """The numbers in a name, without leading zeros."""
    return tuple(number.lstrip("0") for number in _NUMBER.findall(name))


def _wording(name: str) -> str:
    """A name whatever its numbers are."""
    return _NUMBER.sub("0", name)
