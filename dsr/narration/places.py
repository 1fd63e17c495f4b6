"""Tells where each thing is: as it is seen, or as it is believed to be though unseen, and why."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Edge, Node
from dsr.narration.chances import chances_of_thing
from dsr.narration.statements import (
    Basis,
    Moment,
    Place,
    StatedClaim,
    Statement,
    Subject,
    is_seen,
    length_of_time,
    percept_evidence,
    place_of,
    place_words,
)
from dsr.timeline import Entry, explanations, read_entry
from dsr.visibility import CAMERA
from dsr.vocabulary.calibration import IN_DOUBT, PROVISIONAL, provisional
from dsr.vocabulary.relations import SURFACES, is_present, nodes_by_name
from dsr.vocabulary.relations import THINGS as THING_TYPES
from dsr.vocabulary.sentences import RELATION_WORDS, explained_sentence, listed

GRIPPER = "gripper"
"""`source` of what a gripper feels between its pads."""
PERCEIVED = ("RT",)
"""Types of the edges along which a percept leads to the world."""
_WITHIN = 0.5
"""Share of the least extent of a thing, from which two places of it have less than half of it in common"""
_DETECTABLE = 0.5
"""Share of what a thing is recognised by, from which a camera that sees so much should recognise the thing."""


def place_statements(moment: Moment) -> list[Statement]:
    """Statements about the place of each thing, where else it could be, and whether it is surprising, by name."""
    found: list[Statement] = []
    for node in nodes_by_name(moment.memory, THING_TYPES):
        found.append(place_of_thing(moment, node))
        if (chances := chances_of_thing(moment, node)) is not None:
            found.append(chances)
        if node.get("surprising") is True:
            found.append(surprise_of(node))
    return found


def place_of_thing(moment: Moment, node: Node) -> Statement:
    """Tell where a thing is."""
    now = moment.now
    evidence = percept_evidence(moment, node.name)
    if not is_present(node):
        return _gone(moment, node, evidence)
    supports, contents, holders = relations_of(moment, node.name)
    pose = moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    place = None if pose is None else place_of(pose)
    if place is None and not (supports or contents or holders):
        text = f"Nobody knows where {node.name} is."
        return Statement(
            text=text, subject=Subject.PLACE, basis=Basis.OWN, names=(node.name,), evidence=evidence
        )  # fmt: skip
    relations = [*contents, *supports]
    evidence |= {"relations": [relation_evidence(edge) for edge in (*relations, *holders)]}
    around = [one for edge in relations if (one := moment.memory.get_node(edge.dst)) is not None]
    is_felt = any(edge.get("source") == GRIPPER for edge in holders)
    is_doubted = (
        node.get("surprising") is True or bool(_doubtful_camera(moment, evidence)) or seen_elsewhere(moment, node) > 0.0
    )
    in_place = (bool(around) or is_felt) and not is_doubted
    perceived = in_place and all(is_seen(one, now) for one in (node, *around))
    claims, words = whereabouts(node.name, contents, supports, holders, place, around, perceived=perceived)
    if perceived:
        text = f"{node.name} {words}."
    else:
        about = [*around, *_hands(moment, holders)]
        reason = why_believed(moment, node, about, _doubtful_camera(moment, evidence))
        text = f"{node.name} is believed to {words}{f': {reason}' if reason else ''}."
    return Statement(
        text=text, subject=Subject.PLACE, basis=Basis.PERCEIVED if perceived else Basis.BELIEVED,
        names=(node.name, *(edge.dst for edge in relations), *(edge.src for edge in holders)), claims=tuple(claims),
        evidence=evidence,
    )  # fmt: skip


def relations_of(moment: Moment, name: str) -> tuple[list[Edge], list[Edge], list[Edge]]:
    """The edges that tell what a thing rests on, what it is in, and who holds it, each by name.

    What a thing is in counts for more than that it rests on the bottom of that.
    """
    contents = sorted(moment.memory.edges("in", src=name), key=lambda edge: edge.dst)
    around = {edge.dst for edge in contents}
    supports = [edge for edge in moment.memory.edges("on", src=name) if edge.dst not in around]
    holders = sorted(moment.memory.edges("grasping", dst=name), key=lambda edge: edge.src)
    return sorted(supports, key=lambda edge: edge.dst), contents, holders


def relation_evidence(edge: Edge) -> dict[str, Any]:
    """What a relation rests on, as plain data."""
    known = {"relation": edge.type, "of": edge.src, "to": edge.dst}
    return known | {name: edge[name] for name in ("source", "since", "handling") if name in edge}


def seen_elsewhere(moment: Moment, node: Node) -> float:
    """How far (m) from its believed place a thing is seen, if that is too far to be noise; else 0.

    What is seen anew is where it was believed to be until the belief has taken the percept in, or surprise has.
    """
    if not is_seen(node, moment.now):
        return 0.0
    seen = moment.memory.get_transform(WORLD, node.name, types=PERCEIVED)
    believed = moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    size = node.get("size")
    if seen is None or believed is None or not isinstance(size, tuple) or not size:
        return 0.0
    far = seen.distance(believed)[0]
    return far if far > _WITHIN * min(size) else 0.0


def _hands(moment: Moment, holders: Iterable[Edge]) -> list[Node]:
    nodes = (moment.memory.get_node(edge.src) for edge in holders)
    return [node for node in nodes if node is not None and node.type == "hand"]


def _doubtful_camera(moment: Moment, evidence: dict[str, Any]) -> str:
    """The camera of the newest percept, if nobody is sure where that camera is; else empty.

    A pose that the calibrator adopted provisionally is in doubt until it is settled, whatever `mount` says meanwhile:
    the mount is `confirmed` for the seconds in which beliefs follow the new pose.
    """
    name = str(evidence.get("percept", {}).get("from", ""))
    camera = moment.memory.get_node(name)
    if camera is None:
        return ""
    is_doubted = camera.get("mount") in (IN_DOUBT, PROVISIONAL) or provisional(moment.memory, name) is not None
    return name if is_doubted else ""


def why_believed(moment: Moment, node: Node, around: Iterable[Node] = (), doubtful: str = "") -> str:
    """Why a thing is only believed to be somewhere: unseen since when, what hides it, which explanation.

    Args:
        moment: the graph, and now.
        node: of the thing.
        around: what the thing rests on, is in or is held by.
        doubtful: name of the camera that sees the thing, if that camera may have moved.
    """
    now = moment.now
    parts = []
    if not is_seen(node, now):
        parts.append(f"unseen for {length_of_time(now - node['last_seen'])}" if "last_seen" in node else "never seen")
        parts += [reason] if (reason := why_unseen(moment, node.name)) else []
    elif unseen := [one.name for one in around if not is_seen(one, now)]:
        parts.append(f"{listed(unseen)} {'is' if len(unseen) == 1 else 'are'} unseen")
    elif node.get("surprising") is True:
        parts.append("it surprises the robot")
    elif doubtful:
        parts.append(f"{doubtful} may have moved")
    elif (far := seen_elsewhere(moment, node)) > 0.0:
        parts.append(f"it is seen {100.0 * far:.0f} cm from there")
    elif not around:
        parts.append("nothing is known to hold it there")
    entry = latest_explanation(moment, node.name)
    if entry is not None and entry.begin >= node.get("last_seen", entry.begin) - 1e-6:
        parts.append(f"the robot concluded that {explained_sentence({**entry.details, 'explanation': entry.text})}")
    return ", ".join(parts)


def why_unseen(moment: Moment, name: str) -> str:
    """Which things are believed to hide a thing from each camera, or that the thing is out of sight; may be empty."""
    hidden: dict[str, list[str]] = {}
    outside, expected = [], []
    for edge in sorted(moment.memory.edges("sees", dst=name), key=lambda edge: edge.src):
        looker = moment.memory.get_node(edge.src)
        if looker is None or looker.type != CAMERA:
            continue
        hider = edge.get("covered_by") or edge.get("hidden_by") or ""
        if edge.get("detectable", edge.get("share", 0.0)) >= _DETECTABLE:
            expected.append(edge.src)
        elif hider:
            hidden.setdefault(hider, []).append(edge.src)
        else:
            outside.append(edge.src)
    parts = [f"{hider} hides it from {listed(cameras)}" for hider, cameras in hidden.items()]
    parts += [f"out of the sight of {listed(outside)}"] if outside else []
    parts += [f"though {listed(expected)} should see it"] if expected else []
    return ", ".join(parts)


def latest_explanation(moment: Moment, name: str) -> Entry | None:
    """The newest explanation in which a thing takes part; None if there is none."""
    entries = (read_entry(node) for node in reversed(explanations(moment.memory)))
    return next((entry for entry in entries if entry is not None and name in entry.participants), None)


def whereabouts(
    name: str, contents: list[Edge], supports: list[Edge], holders: list[Edge], place: Place | None,
    around: list[Node], *, perceived: bool,
) -> tuple[list[StatedClaim], str]:  # fmt: skip
    """What a thing is in, on or held by, as claims, and as words behind its name: `rests on table, at x ...`.

    Args:
        name: of the thing.
        contents: edges `in` from the thing.
        supports: edges `on` from the thing.
        holders: edges `grasping` to the thing.
        place: m, where the thing is; None if unknown.
        around: nodes of what it rests on or is in.
        perceived: whether the words follow the name ("rests"), or "is believed to" ("rest").
    """
    claims = [StatedClaim(edge.type, (name, edge.dst)) for edge in (*contents, *supports)]
    words = []
    for edges in (contents, supports):
        if edges:
            known = RELATION_WORDS[edges[0].type]
            words.append(f"{known.holds if perceived else known.hold} {listed([edge.dst for edge in edges])}")
    if not words and holders:
        words.append(f"{'is' if perceived else 'be'} held by {listed([edge.src for edge in holders])}")
    is_located = not words or any(node.type in SURFACES for node in around)
    if place is not None and is_located:
        claims.append(StatedClaim("at", (name,), place))
        where = place_words(place, height=not words)
        words = [f"{' and '.join(words)}, {where}"] if words else [f"{'is' if perceived else 'be'} {where}"]
    return claims, " and ".join(words)


def _gone(moment: Moment, node: Node, evidence: dict[str, Any]) -> Statement:
    entry = latest_explanation(moment, node.name)
    because = "" if entry is None else explained_sentence({**entry.details, "explanation": entry.text})
    if entry is not None:
        evidence = {**evidence, "explanation": entry.name}
    text = f"{node.name} is believed to be gone{f': the robot concluded that {because}' if because else ''}."
    return Statement(
        text=text, subject=Subject.PLACE, basis=Basis.BELIEVED, names=(node.name,),
        claims=(StatedClaim("gone", (node.name,)),), evidence=evidence,
    )  # fmt: skip


def surprise_of(node: Node) -> Statement:
    """Tell that a thing surprises the robot, and why."""
    why = node.get("surprise", "")
    text = f"{node.name} surprises the robot{f': {why}' if why else ''}."
    return Statement(text=text, subject=Subject.SURPRISE, basis=Basis.OWN, names=(node.name,))
