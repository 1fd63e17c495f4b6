"""Tells where a thing could be: the alternatives of the belief in words, with their probabilities."""

from __future__ import annotations

from typing import Any

from dsr.believing.distribution import Alternative, Whereabouts, are_at_one_place
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose, position_deviation
from dsr.narration.statements import Basis, Moment, StatedClaim, Statement, Subject, place_of, place_words
from dsr.vocabulary.sentences import listed, percent

LEAST = 0.05
"""1, probability from which an alternative is told in a sentence"""
_VAGUE = 0.05  # m, standard deviation from which a place is told with it


def chances_of_thing(moment: Moment, node: Node) -> Statement | None:
    """Where else a thing may be than it is believed to be; None if nothing else is probable enough to be told."""
    where = moment.memory.belief(node.name)
    if where is None:
        return None
    others = [one for one in where.alternatives[1:] if one.weight >= LEAST and _is_told_apart(one, where.best)]
    if not others:
        return None
    told = "; or ".join(f"{alternative_words(one)} ({percent(one.weight)})" for one in others)
    likely = alternative_words(where.best)
    text = f"{node.name} is probably {likely} ({percent(where.best.weight)}), but could be {told}."
    names = {name for one in (where.best, *others) for name in (one.hand, *one.containers, *one.supports) if name}
    return Statement(
        text=text, subject=Subject.PLACE, basis=Basis.BELIEVED, names=(node.name, *sorted(names)),
        claims=tuple(_claim(node.name, where.best)), confidence=where.best.weight,
        evidence={"alternatives": chances(where)},
    )  # fmt: skip


def chances(where: Whereabouts) -> list[dict[str, Any]]:
    """The alternatives of a thing as plain data, the most probable first: JSON, and rows of a table."""
    return [_plain(one) for one in where.alternatives]


def unweighed(pose: Pose) -> dict[str, Any]:
    """The one place of a thing that the belief weighs no alternatives of: as in `chances`, without a probability."""
    return _plain(Alternative(weight=1.0, pose=pose)) | {"probability": None}


def alternative_words(one: Alternative) -> str:
    """An alternative in words: `in cup_1`, `in hand_0`, `gone`, `on table, at x 0.30 m, y 0.10 m`."""
    if one.pose is None:
        return "gone"
    parts = []
    if one.hand:
        parts.append(f"in {one.hand}")
    elif one.containers:
        parts.append(f"in {listed(one.containers[:1])}")
    elif one.supports:
        parts.append(f"on {listed(one.supports)}")
    place = place_words(place_of(one.pose), height=not parts)
    deviation = 0.0 if one.pose.cov is None else position_deviation(one.pose)
    if deviation >= _VAGUE:
        place = f"within about {100.0 * deviation:.0f} cm of {place.removeprefix('at ')}"
    return ", ".join([*parts, place])


def _plain(one: Alternative) -> dict[str, Any]:
    """An alternative as plain data: m, quaternion xyzw."""
    return {
        "probability": round(one.weight, 4),
        "where": alternative_words(one),
        "place": None if one.pose is None else [round(number, 4) for number in one.pose.t],
        "rotation": None if one.pose is None else [round(number, 4) for number in one.pose.q],
        "deviation": None if one.pose is None or one.pose.cov is None else round(position_deviation(one.pose), 4),
        "gone": one.is_gone,
        "hand": one.hand,
        "in": list(one.containers),
        "on": list(one.supports),
        "reason": one.reason,
    }


def _is_told_apart(one: Alternative, best: Alternative) -> bool:
    """Whether an alternative is more than the best one less exactly, or than the same in words."""
    if alternative_words(one) == alternative_words(best):
        return False
    if one.holders != best.holders or one.is_gone != best.is_gone:
        return True
    return not are_at_one_place(one, best)


def _claim(name: str, best: Alternative) -> list[StatedClaim]:
    if best.pose is None:
        return [StatedClaim("gone", (name,))]
    found = [StatedClaim("in", (name, container)) for container in best.containers]
    found += [StatedClaim("on", (name, support)) for support in best.supports]
    return [*found, StatedClaim("at", (name,), place_of(best.pose))]
