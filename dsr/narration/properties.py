"""Answers what a thing is like, what is closest to it, what is not seen, and how sure the robot is."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.narration.answer import Response, joined, understood
from dsr.narration.chances import chances_of_thing
from dsr.narration.naming import is_robot, node_of, nodes_called
from dsr.narration.places import place_of_thing
from dsr.narration.questions import Query
from dsr.narration.statements import Basis, Moment, Statement, Subject, is_seen
from dsr.vocabulary.relations import THINGS, is_present
from dsr.vocabulary.sentences import listed

_ALIKE = 0.01
"""m between two heights or lengths that count as the same: what percepts are off by"""


class _Measure(NamedTuple):
    """What the highest, the largest, the heaviest of some things has most of, or least."""

    of: Callable[[Moment, Node], float | None]
    """Its value for a thing, in m or kg; None if that is not known."""
    told: str
    """What is said of that thing."""
    unknown: str
    """What is not known if it is of no thing."""
    alike: float
    """Values that differ less count as the same, m or kg."""
    is_least: bool = False
    """Whether the least is asked for."""


def _height(moment: Moment, node: Node) -> float | None:
    pose = moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    return None if pose is None else pose.t[2]


def _diagonal(moment: Moment, node: Node) -> float | None:
    size = node.get("size")
    return None if size is None else math.hypot(*size)


def _mass(moment: Moment, node: Node) -> float | None:
    mass: float | None = node.get("mass")
    return mass


_MEASURES = {
    "top": _Measure(_height, "highest", "where", _ALIKE),
    "bottom": _Measure(_height, "lowest", "where", _ALIKE, is_least=True),
    "largest": _Measure(_diagonal, "largest", "how large", _ALIKE),
    "smallest": _Measure(_diagonal, "smallest", "how large", _ALIKE, is_least=True),
    "heaviest": _Measure(_mass, "heaviest", "how heavy", 0.0),
    "lightest": _Measure(_mass, "lightest", "how heavy", 0.0, is_least=True),
}


def property_of(moment: Moment, query: Query) -> Response:
    """The colour, size or mass of a thing, as the graph has it."""
    node = node_of(moment, query.things[0])
    known = {"colour": "color", "large": "size", "heavy": "mass"}[query.word]
    value = node.get(known)
    if value is None:
        return understood(f"The {known} of {node.name} is not known.")
    if query.word == "heavy":
        text = f"{node.name} weighs {value:g} kg."
    elif query.word == "large":
        text = f"{node.name} is {' x '.join(f'{length:.3f}' for length in value)} m large, along x, y and z."
    else:
        red, green, blue = (f"{part:.2f}" for part in value)
        text = f"{node.name} has the colour red {red}, green {green}, blue {blue} (each 0 to 1)."
    told = Statement(
        text=text, subject=Subject.PLACE, basis=Basis.OWN, names=(node.name,),
        evidence={known: [float(part) for part in value] if known != "mass" else value},
    )  # fmt: skip
    return understood(text, [told])


def sure(moment: Moment, query: Query) -> Response:
    """How sure the robot is of where a thing is: what that rests on, and the deviation of the last percept."""
    node = node_of(moment, query.things[1])
    told = place_of_thing(moment, node)
    percept = told.evidence.get("percept", {})
    deviation = percept.get("position_deviation_m")
    known = f" The percept deviates by {1000.0 * deviation:.0f} mm (one standard deviation)." if deviation else ""
    how = "It is seen." if told.basis is Basis.PERCEIVED else "It is not seen so, only believed."
    return understood(f"{how}{known} {told.text}", [told], verdict=told.basis is Basis.PERCEIVED)


def where_else(moment: Moment, query: Query) -> Response:
    """Where else than it is believed to be a thing could be, and whether it could."""
    node = node_of(moment, query.things[0])
    place, chances = place_of_thing(moment, node), chances_of_thing(moment, node)
    if chances is not None:
        return understood(chances.text, [chances], verdict=True)
    return understood(f"No other place is probable. {place.text}", [place], verdict=False)


def closest(moment: Moment, query: Query) -> Response:
    """The thing whose centre is closest to that of another, as believed."""
    node = node_of(moment, query.things[-1])
    kind = query.things[0] if len(query.things) > 1 else "thing"
    here = moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    others = [one for one in nodes_called(moment, kind) if is_present(one) and one.name != node.name]
    poses = {one.name: moment.memory.get_transform(WORLD, one.name, types=BELIEVED) for one in others}
    far = {} if here is None else {name: here.distance(pose)[0] for name, pose in poses.items() if pose is not None}
    if not far:
        return understood(f"Nothing is known to be close to {node.name}.")
    name = min(far, key=lambda one: (far[one], one))
    text = f"{name} is closest to {node.name}, {far[name]:.2f} m from centre to centre."
    places = [place_of_thing(moment, one) for one in (moment.memory.node(name), node) if one.type in THINGS]
    return understood(f"{text} {joined(places)}", places, names=[name])


def distance(moment: Moment, query: Query) -> Response:
    """How far the centres of two things are apart, as believed."""
    one, other = (node_of(moment, asked) for asked in query.things)
    poses = [moment.memory.get_transform(WORLD, node.name, types=BELIEVED) for node in (one, other)]
    if poses[0] is None or poses[1] is None:
        return understood(f"Nobody knows where {one.name if poses[0] is None else other.name} is.")
    far = poses[0].distance(poses[1])[0]
    told = [place_of_thing(moment, node) for node in (one, other) if node.type in THINGS]
    text = f"{one.name} and {other.name} are {far:.2f} m apart, from centre to centre."
    return understood(f"{text} {joined(told)}".strip(), told, names=[one.name, other.name])


def extreme(moment: Moment, query: Query) -> Response:
    """Which thing of a kind is highest, lowest, largest, ...; several where nobody could tell them apart."""
    measure = _MEASURES[query.word]
    kind = next((asked for asked in query.things if nodes_called(moment, asked)), "thing")
    present = [node for node in nodes_called(moment, kind) if is_present(node)]
    values = {node.name: value for node in present if (value := measure.of(moment, node)) is not None}
    if not values:
        return understood(f"Nobody knows {measure.unknown} any of them is.")
    last = (min if measure.is_least else max)(values.values())
    names = sorted(name for name, value in values.items() if abs(value - last) <= measure.alike)
    told = [place_of_thing(moment, moment.memory.node(name)) for name in names]
    text = f"{listed(names)} {'is' if len(names) == 1 else 'are'} {measure.told}."
    return understood(f"{text} {joined(told)}", told, names=names)


def which_on(moment: Moment, query: Query) -> Response:
    """Which things of a kind are on or in another thing, tables not counted, and whether any is."""
    kind = "in" if query.relation == "in" else "on"
    wanted = {node.name for node in nodes_called(moment, query.things[0] if query.things else "thing")}
    things = {node.name for node in moment.memory.nodes(THINGS)}
    edges = [edge for edge in moment.memory.edges(kind) if edge.dst in things]
    ends = [edge.dst if query.relation == "under" else edge.src for edge in edges]
    names = sorted(wanted.intersection(ends))
    told = [place_of_thing(moment, moment.memory.node(name)) for name in names]
    is_any = query.kind == "any_on"
    begin = f"{'Yes' if names else 'No'}: " if is_any else ""
    text = f"{begin}{listed(names) or 'none of them'}. {joined(told)}".strip()
    return understood(text, told, verdict=bool(names) if is_any else None, names=names)


def which_state(moment: Moment, query: Query) -> Response:
    """Which things of a kind are gone, hidden, seen, surprising or there, and whether any is."""
    found = []
    for node in nodes_called(moment, query.things[0] if query.things else "thing"):
        there, seen = is_present(node), is_seen(node, moment.now)
        holds = {
            "there": there, "gone": not there, "visible": there and seen, "unseen": there and not seen,
            "surprising": node.get("surprising") is True,
        }[query.word]  # fmt: skip
        found += [node] if holds else []
    told = [place_of_thing(moment, node) for node in found]
    names = [node.name for node in found]
    begin = "Yes: " if query.kind == "any_state" and names else "No: " if query.kind == "any_state" else ""
    text = f"{begin}{listed(names) or 'none of them'}. {joined(told)}".strip()
    return understood(text, told, verdict=bool(names) if query.kind == "any_state" else None, names=names)


def what_unseen(moment: Moment, query: Query) -> Response:
    """Which things the robot, a camera or a person does not see."""
    viewer = query.things[-1]
    things = nodes_called(moment, query.things[0] if len(query.things) > 1 else "thing")
    there = [node for node in things if is_present(node)]
    if is_robot(viewer):
        who, unseen = "The robot", [node for node in there if not is_seen(node, moment.now)]
    else:
        who = node_of(moment, viewer).name
        edges = {edge.dst: edge.get("visible") is True for edge in moment.memory.edges("sees", src=who)}
        unseen = [node for node in there if not edges.get(node.name, False)]
    names = [node.name for node in unseen]
    told = [place_of_thing(moment, node) for node in unseen]
    text = f"{who} does not see {listed(names)}." if names else f"{who} sees all of them."
    return understood(f"{text} {joined(told)}".strip(), told, names=names)
