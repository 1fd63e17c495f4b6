"""The account of a memory: all that is told of a moment, in order, or the part of it that is about some names."""

from __future__ import annotations

from collections.abc import Iterable

from dsr.errors import ConfigError, suggest
from dsr.narration.doings import holding_statements, sight_statements, wish_statements
from dsr.narration.happenings import happening_statements
from dsr.narration.places import place_statements
from dsr.narration.statements import Moment, Statement, Subject
from dsr.timeline import EVENT, SITUATION, SUMMARY

LATELY = 60.0
"""s before now of which an account tells, unless told otherwise: what a person still remembers having seen."""

_TITLES = {
    Subject.PLACE: "Where things are", Subject.SURPRISE: "Where things are", Subject.HOLDING: "Who holds what",
    Subject.SIGHT: "Who sees what", Subject.HAPPENED: "What happened", Subject.WANTED: "What the robot wants",
    Subject.FORBIDDEN: "What the robot wants",
}  # fmt: skip


def account(moment: Moment, *, since: float | None = None, about: Iterable[str] = ()) -> list[Statement]:
    """Tell a memory in sentences: where things are, who holds and sees what, what happened, what the robot wants.

    Args:
        moment: a base world, and now.
        since: s, from when on to tell what happened; `LATELY` before now if None.
        about: names of nodes; only statements in which one of them occurs. All statements if there are none.

    Raises:
        ConfigError: for a name that no node has and nothing that happened is about.
    """
    begin = moment.now - LATELY if since is None else since
    told = [
        *place_statements(moment),
        *holding_statements(moment),
        *sight_statements(moment),
        *happening_statements(moment, begin),
        *wish_statements(moment),
    ]
    wanted = set(about)
    if not wanted:
        return told
    check_names(moment, wanted, told)
    return [statement for statement in told if not wanted.isdisjoint(statement.names)]


def chapters(told: Iterable[Statement]) -> list[tuple[str, list[Statement]]]:
    """Statements in their order, those that follow one another about one matter below one title."""
    found: list[tuple[str, list[Statement]]] = []
    for statement in told:
        title = _TITLES[statement.subject]
        if not found or found[-1][0] != title:
            found.append((title, []))
        found[-1][1].append(statement)
    return found


def check_names(moment: Moment, names: Iterable[str], told: Iterable[Statement] = ()) -> None:
    """Raise `ConfigError` for a name that is neither a node's nor told of."""
    mentioned = {name for statement in told for name in statement.names}
    for name in sorted(set(names) - mentioned):
        if name not in moment.memory:
            known = {node.name for node in moment.memory.nodes() if node.type not in (EVENT, SITUATION, SUMMARY)}
            raise ConfigError(f"there is no {name!r}; {suggest(name, known)}")
