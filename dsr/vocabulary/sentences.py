"""Has the words of sentences: explanations (`cube_3 moved, and cube_4 beneath it moved along`), relations, numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from dsr.vocabulary import explained
from dsr.vocabulary.explained import HELD_TOO, ExplainedChange, changes_of

_EACH = {
    explained.MOVED: "{} moved",
    explained.TURNED: "{} turned",
    explained.FELL: "{} fell",
    explained.REMOVED: "{} {was} taken away",
    explained.APPEARED: "{} appeared",
    explained.HELD: "something holds {}",
    explained.FALSE_PERCEPT: "what was seen of {} is false",
}
"""Kinds of changes of one object each. Several of one kind are told together."""
_TOGETHER = {
    explained.WITH_SUPPORTS: "{0} moved, and {1} beneath it moved along",
    explained.WITH_CONTENTS: "{0} moved, and {1} in or on it moved along",
    explained.UNDER: "{0} came beneath {1}",
    explained.PLACED_UNDER: "{0} came beneath {1}",
    explained.TAKEN_ALONG: "{1} took {0} along",
}
"""Kinds of changes of two groups of objects."""
_FIRST_AND_OTHERS = {
    explained.SWAPPED: "{0} and {1} changed places",
    explained.PUT_ON: "{0} stands on {1} now",
    explained.RELATION_ENDED: "{0} does not stand on {1} any more",
}
"""Kinds of changes of one group, whose first object has another part than the others."""
_WHOLE = {
    explained.CAMERA_MOVED: "a camera moved",
    explained.NOTHING_CHANGED: "nothing changed",
}
"""Kinds of changes without objects."""


class RelationWords(NamedTuple):
    """The words of a relation between two things, each to stand between their names."""

    holds: str
    """That the relation holds now."""
    hold: str
    """The same after "is believed to"."""
    began: str
    ended: str


RELATION_WORDS = {
    "on": RelationWords("rests on", "rest on", "came to rest on", "stopped resting on"),
    "in": RelationWords("is in", "be in", "came to be in", "came out of"),
    "grasping": RelationWords("holds", "hold", "took hold of", "let go of"),
    "sees": RelationWords("sees", "see", "came to see", "lost sight of"),
}
"""The words of each type of edges that sentences tell of."""
TOUCHING = RelationWords("touches", "touch", "touched", "stopped touching")
"""The words of an edge `grasping` from a hand that has hold of one side only."""


class Rejected(NamedTuple):
    """An explanation that was not adopted."""

    score: str
    """nats, as its event tells it; the chosen explanation has a smaller score"""
    sentence: str


def sentence_of(changes: Iterable[ExplainedChange]) -> str:
    """Tell changes as one sentence without a full stop; those of an unknown kind as they are written.

    Returns:
        The sentence, empty if there are no changes. Its parts are joined by semicolons.
    """
    merged: dict[tuple[str, int], list[ExplainedChange]] = {}
    for position, change in enumerate(changes):
        is_each = change.kind in _EACH and len(change.groups) == 1
        merged.setdefault((change.kind, -1 if is_each else position), []).append(change)
    return "; ".join(_told(same) for same in merged.values())


def explained_sentence(attributes: Mapping[str, Any]) -> str:
    """Tell the explanation that an event `explained` holds; as it is written, if it holds no changes.

    Args:
        attributes: of the event.
    """
    text = str(attributes.get("explanation", ""))
    return sentence_of(changes_of(attributes, text)) or text


def rejected_sentences(attributes: Mapping[str, Any]) -> list[Rejected]:
    """List the explanations that an event `explained` holds as rejected, the best first.

    Args:
        attributes: of the event.
    """
    found = []
    for line in str(attributes.get("alternatives", "")).splitlines():
        score, _, text = line.partition(" ")
        found.append(Rejected(score, sentence_of(changes_of({}, text)) or text))
    return found


def listed(names: Sequence[str]) -> str:
    """Names as a sentence lists them: `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _told(same: Sequence[ExplainedChange]) -> str:
    """Changes of the same kind, of which there are several only if they concern one object each."""
    kind, groups = same[0].kind, same[0].groups
    if kind in _WHOLE and not groups:
        return _WHOLE[kind]
    names = [name for change in same for group in change.groups for name in group]
    if kind in _EACH and len(groups) == 1 and names:
        return _EACH[kind].format(listed(names), was="was" if len(names) == 1 else "were")
    if kind in _TOGETHER and len(groups) == 2 and all(groups):
        return _TOGETHER[kind].format(*map(listed, groups))
    if kind in _FIRST_AND_OTHERS and len(groups) == 1 and len(groups[0]) > 1:
        return _FIRST_AND_OTHERS[kind].format(groups[0][0], listed(groups[0][1:]))
    if kind.startswith(HELD_TOO) and groups and groups[0]:
        alone = _told([ExplainedChange(kind.removeprefix(HELD_TOO), groups)])
        return f"{alone}; something holds {groups[0][0]}"
    return str(same[0])


def percent(probability: float) -> str:
    """A probability in words: `62 %`; what is neither certain nor impossible is never told as 100 or 0 %."""
    rounded = round(100.0 * probability)
    if rounded in (0, 100) and 0.0 < probability < 1.0:
        return "less than 1 %" if rounded == 0 else "more than 99 %"
    return f"{rounded} %"
