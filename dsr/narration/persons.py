"""Tells what a person sees, remembers and believes, from the world that is kept for that person."""

from __future__ import annotations

from dsr.errors import ConfigError, WorldNotFoundError, suggest
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.narration.account import LATELY
from dsr.narration.happenings import happening_statements
from dsr.narration.places import place_of_thing, relation_evidence, relations_of, whereabouts
from dsr.narration.statements import Basis, Moment, StatedClaim, Statement, Subject, ago, percept_evidence, place_of
from dsr.visibility import PERSON
from dsr.vocabulary.relations import THINGS, is_present, nodes_by_name

VIEW = "view_of_"
"""Before the name of a person: the world that `agents.perspectives` keeps."""
ELSEWHERE = 0.05
"""m from which the places that a person and the robot believe in are two: about the size of a small thing"""


def world_of(moment: Moment, person: str) -> Moment:
    """The same moment in the world of a person.

    Raises:
        ConfigError: if there is no such person, or nobody keeps that world.
    """
    persons = [node.name for node in moment.memory.nodes(PERSON)]
    if person not in persons:
        raise ConfigError(f"there is no person {person!r}; {suggest(person, persons)}")
    try:
        return moment.in_world(moment.memory.world(f"{VIEW}{person}"))
    except WorldNotFoundError as error:
        raise ConfigError(f"nobody keeps the world of {person} (agent perspectives): {error}") from error


def person_account(moment: Moment, person: str, *, since: float | None = None) -> list[Statement]:
    """Tell what a person sees and believes, where the robot believes otherwise, and what the person saw happen.

    Args:
        moment: the base world, and now.
        person: name of the person's node.
        since: s, from when on to tell what happened; `LATELY` before now if None.

    Raises:
        ConfigError: if there is no such person, or nobody keeps that world.
    """
    world = world_of(moment, person)
    found: list[Statement] = []
    for node in nodes_by_name(moment.memory, THINGS):
        found += thing_by_person(moment, world, person, node)
    begin = moment.now - LATELY if since is None else since
    return [*found, *happening_statements(world, begin)]


def thing_by_person(moment: Moment, world: Moment, person: str, node: Node) -> list[Statement]:
    """Tell where a person believes a thing to be, and where the robot does if it believes otherwise."""
    known = world.memory.get_node(node.name)
    if known is None:
        text = f"{person} has never seen {node.name}."
        return [Statement(text=text, subject=Subject.PLACE, basis=Basis.BELIEVED, names=(person, node.name))]
    told = _known(world, person, known)
    return [told, _otherwise(moment, node)] if _differ(moment, world, node, known) else [told]


def _known(world: Moment, person: str, node: Node) -> Statement:
    supports, contents, holders = relations_of(world, node.name)
    pose = _pose(world, node)
    relations = [*contents, *supports]
    names = (person, node.name, *(edge.dst for edge in relations))
    evidence = percept_evidence(world, node.name) | {"relations": [relation_evidence(edge) for edge in relations]}
    if pose is None:
        text = f"{person} does not know where {node.name} is{_last_seen(world, person, node)}."
        return Statement(
            text=text, subject=Subject.PLACE, basis=Basis.BELIEVED, names=names, evidence=evidence,
            claims=(StatedClaim("gone", (node.name,)),),
        )  # fmt: skip
    around = [one for edge in relations if (one := world.memory.get_node(edge.dst)) is not None]
    place = place_of(pose)
    claims, words = whereabouts(node.name, contents, supports, holders, place, around, perceived=True)
    if node.get("perceived") is True:
        text = f"{person} sees {node.name} and believes that it {words}."
    else:
        text = f"{person} believes that {node.name} {words}{_last_seen(world, person, node)}."
    return Statement(
        text=text, subject=Subject.PLACE, basis=Basis.BELIEVED, names=names, claims=tuple(claims), evidence=evidence
    )  # fmt: skip


def _last_seen(world: Moment, person: str, node: Node) -> str:
    if "last_seen" not in node:
        return ""
    return f": {person} saw it last {ago(world.now - node['last_seen'])}"


def _pose(moment: Moment, node: Node) -> Pose | None:
    return moment.memory.get_transform(WORLD, node.name, types=BELIEVED) if is_present(node) else None


def _differ(moment: Moment, world: Moment, node: Node, known: Node) -> bool:
    """Whether the robot and the person believe that a thing is in two different places, or things."""
    own, theirs = _pose(moment, node), _pose(world, known)
    if own is None or theirs is None:
        return own is not theirs
    inside = [{edge.dst for edge in of.memory.edges("in", src=node.name)} for of in (moment, world)]
    return inside[0] != inside[1] or own.distance(theirs)[0] > ELSEWHERE


def _otherwise(moment: Moment, node: Node) -> Statement:
    told = place_of_thing(moment, node)
    text = f"The robot knows otherwise: {told.text}" if told.basis is Basis.PERCEIVED else f"But {told.text}"
    return Statement(
        text=text, subject=told.subject, basis=told.basis, names=told.names, claims=told.claims, evidence=told.evidence
    )  # fmt: skip
