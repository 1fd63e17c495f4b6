"""Puts a thing somewhere by a relation, as seen from a view, where physics lets it stay: "the ball behind human_1"."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from dsr.errors import ConfigError, ImaginationError, TransformError, suggest
from dsr.frames.tree import BELIEVED, WORLD
from dsr.imagining.scenes import IMPRECISE, differences, keep, place_of, surface_below
from dsr.imagining.thinking import Thought
from dsr.math3d.quaternions import from_rotvec, rotate
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.spatial import EGOCENTRIC, Box, View, margin, read_scene, read_view
from dsr.spatial.boxes import overlap
from dsr.visibility import PERSON, PERSPECTIVES
from dsr.vocabulary.relations import MODELLED, SURFACES
from dsr.vocabulary.what_if import Answer, Question

PLACEABLE = ("in_front_of", "behind", "left_of", "right_of", "next_to", "close_to", "above", "on_top", "in")
"""Relations by which a thing can be put somewhere."""
_GAPS = (0.02, 0.06, 0.12, 0.25, 0.45)  # m, from what it is related to
_ASIDE = (0.0, 0.08, -0.08, 0.2, -0.2)  # m, across the direction
_MOST_QUESTIONS = 16
_SECONDS = 2.0  # that are simulated
_DISTURBED = 0.01  # m, by which nothing else may move
_ABOVE = 5e-4  # m, over what it is put on
_DEEPEST = 0.004  # m that boxes may reach into each other
_BODY = (0.3, 0.5, 1.6)  # m, of a person
_CAMERA = (0.1, 0.1, 0.1)
_EYES = 1.5  # m, from the ground, of a person


def placed(base: Memory, world: Memory, name: str, relation: str, reference: str, viewpoint: str = "") -> Thought[Pose]:
    """Put a thing of `world` where it is in a relation to something there, and where it stays by physics.

    The thing need not be anywhere before, nor known in the base: a node with a `size` will do. What came of it is kept
    in `world`, where nothing else may have moved by more than 10 mm.

    Args:
        base: the world whose belief is simulated.
        world: another one, as a fork of it.
        name: of the thing.
        relation: one of `PLACEABLE`.
        reference: a thing, a table, a person or a camera.
        viewpoint: a camera or person from whom the relation is seen. By default it is `reference` itself, if it has a
            front of its own: then what is before its eyes is in front of it.

    Returns:
        world_from_thing.

    Raises:
        ConfigError: for names and relations that cannot be used, and if both worlds are the same.
        ImaginationError: if there is no such place, with the last reason.
    """
    if world.world_name == base.world_name:
        raise ConfigError(f"what is imagined in {base.world_name!r} would be believed there: give a fork of it")
    box, around = _box(world, name), _around(world, reference)
    view = _view(world, relation, reference, viewpoint)
    boxes = read_scene(world).boxes
    others = {key: other for key, other in boxes.items() if key != name and not _is_modelled(world, key)}
    why, asked = "there is no room", 0
    for pose in _candidates(world, box, around, relation, view):
        if _is_inside(Box(pose, box.size), others, relation, reference):
            continue
        asked += 1
        if asked > _MOST_QUESTIONS:
            break
        answer = yield Question(_SECONDS, differences(base, world, elsewhere={name: pose}))
        why = _objection(answer, name, box, relation, reference, around, view)
        if not why and relation in ("above", "on_top"):  # it stays beside the middle, and so in it
            precise = {name: Pose((pose.t[0] - IMPRECISE[0], pose.t[1] - IMPRECISE[1], pose.t[2]), pose.q)}
            answer = yield Question(_SECONDS, differences(base, world, elsewhere=precise))
            why = _objection(answer, name, box, relation, reference, around, view)
        if not why:
            world.update_node(name, present=True)
            keep(world, answer)
            return answer.pose(name)
    raise ImaginationError(f"nowhere to put {name!r} {relation} {reference!r}: {why}")


def _candidates(world: Memory, box: Box, around: Box, relation: str, view: View | None) -> Iterator[Pose]:
    """Where to try, the best places first."""
    turn, half = box.pose.q, 0.5 * (box.top - box.bottom)
    x, y = around.pose.t[0] + IMPRECISE[0], around.pose.t[1] + IMPRECISE[1]
    if relation in ("above", "on_top", "in"):
        for dx, dy in ((0.0, 0.0), *((gap * u, gap * v) for gap in (0.02, 0.05) for u, v in _around_circle())):
            yield Pose((x + dx, y + dy, around.top + half + _ABOVE), turn)
        return
    tables, floors = [], []
    for gap in _GAPS:
        for u, v in _directions(relation, view):
            reach = _half(around, (u, v)) + _half(box, (u, v)) + gap
            for aside in _ASIDE:
                place = x + reach * u - aside * v, y + reach * v + aside * u
                surface = surface_below(world, *place)
                if surface is not None:
                    tables.append(Pose((*place, surface[1] + half + _ABOVE), turn))
                else:
                    floors += [Pose((*place, height + half), turn) for height in _floor_heights(world)]
    yield from tables
    yield from floors


def _directions(relation: str, view: View | None) -> list[tuple[float, float]]:
    """Unit vectors on the ground from what it is related to."""
    if relation in EGOCENTRIC and view is not None:
        axis = view.away if relation in ("in_front_of", "behind") else view.left
        sign = 1.0 if relation in ("behind", "left_of") else -1.0
        return [(sign * axis[0], sign * axis[1])]
    return _around_circle()


def _around_circle() -> list[tuple[float, float]]:
    angles = (k * math.pi / 4.0 for k in range(8))
    return [(math.cos(angle), math.sin(angle)) for angle in angles]


def _half(box: Box, direction: tuple[float, float]) -> float:
    low, high = box.extent((*direction, 0.0))
    return 0.5 * (high - low)


def _floor_heights(world: Memory) -> list[float]:
    """m, from which a thing falls onto the floor, whose height no graph tells."""
    tops = [pose.t[2] for node in world.nodes(SURFACES) if (pose := place_of(world, node.name))]
    lowest = min(tops, default=0.0)
    return [lowest - 0.67, lowest - 0.4]


def _objection(
    answer: Answer, name: str, box: Box, relation: str, reference: str, around: Box, view: View | None
) -> str:
    """Why a thing cannot be where it was put; empty if it can."""
    if answer.refused:
        return answer.refused
    moved = {other: distance for other, distance in answer.effects.items() if other != name and distance > _DISTURBED}
    if moved:
        other = max(moved, key=lambda key: (moved[key], key))
        return f"{other!r} would move by {1e3 * moved[other]:.0f} mm"
    if name not in answer.poses:
        return f"{name!r} cannot be simulated: expected a size"
    if not answer.at_rest:
        return "it would not come to rest"
    there = answer.poses.get(reference)
    place = Box(Pose(there[:3], there[3:]), around.size) if there is not None else around
    if margin(relation, Box(answer.pose(name), box.size), place, view) < 0.0:
        return f"it would not stay {relation} {reference!r}"
    return ""


def _is_inside(box: Box, others: Mapping[str, Box], relation: str, reference: str) -> bool:
    """Whether it would reach into something; contents of a container do reach into its box."""
    return any(
        overlap(box, other) > _DEEPEST and min(box.top - other.bottom, other.top - box.bottom) > _DEEPEST
        for name, other in others.items()
        if not (relation == "in" and name == reference)
    )


def _is_modelled(world: Memory, name: str) -> bool:
    """Whether it may have room within its box, such as a shelf: physics tells whether something fits in."""
    return world.node(name).type in MODELLED


def _box(world: Memory, name: str) -> Box:
    """A thing as a box, upright if it was nowhere."""
    node = world.node(name)
    size = node.get("size")
    if not isinstance(size, tuple) or len(size) != 3:
        raise ConfigError(f"{name!r} does not tell its size: nobody can say where it has room")
    pose = place_of(world, name)
    return Box(pose or Pose(), (size[0], size[1], size[2]))


def _around(world: Memory, name: str) -> Box:
    """What a thing is put in relation to, as a box; of a person, the room that somebody takes who stands upright."""
    node = world.node(name)
    if node.type not in PERSPECTIVES:
        found = read_scene(world).boxes.get(name)
        if found is None:
            raise ConfigError(f"nobody knows where {name!r} is, or how large")
        return found
    try:
        pose = world.transform(WORLD, name, types=BELIEVED)
    except TransformError as error:
        raise ConfigError(f"{name!r}: {error}") from error
    if node.type != PERSON:
        return Box(pose, _CAMERA)
    x_axis = rotate(pose.q, (1.0, 0.0, 0.0))
    yaw = from_rotvec((0.0, 0.0, math.atan2(x_axis[1], x_axis[0])))
    return Box(Pose((pose.t[0], pose.t[1], pose.t[2] + 0.5 * _BODY[2] - _EYES), yaw), _BODY)


def _view(world: Memory, relation: str, reference: str, viewpoint: str) -> View | None:
    """From where the relation is seen; of what has a front of its own, its front is in front."""
    if relation not in PLACEABLE:
        raise ConfigError(f"nothing can be placed {relation!r} something; {suggest(relation, PLACEABLE)}")
    if relation not in EGOCENTRIC:
        return None
    if viewpoint and viewpoint != reference:
        return read_view(world, viewpoint)
    if world.node(reference).type not in PERSPECTIVES:
        raise ConfigError(f"{relation} depends on who looks: expected a viewpoint, for {reference!r} has no front")
    own = read_view(world, reference)
    return View((-own.away[0], -own.away[1], 0.0), own.left)
