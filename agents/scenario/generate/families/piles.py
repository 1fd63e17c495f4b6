"""Episodes of things that stand on, against and beside each other: stacks, perturbations, leaning, propped."""

from __future__ import annotations

import math

from agents.scenario.format.scenario import Drop, PlaceEvent, Push, Remove, Swap, Tilt, Topple
from agents.scenario.generate.bodies import SOLIDS, board, box, can, cube, plank, wall
from agents.scenario.generate.draft import CLEARANCE, GAP, TOP, CrowdedError, EpisodeDraft
from agents.scenario.generate.draw import Draw, NumberRange

SHOVE = NumberRange(0.2, 0.6)
"""m/s that a shove gives a thing: it slides 2 to 50 mm (v^2 / 2 mu g), or tips over"""
LEAN = NumberRange(0.15, 0.45)
"""rad from the vertical, of a board against a box: it neither falls back nor slides away with most frictions"""
PROPPED_AT = NumberRange(0.6, 0.95)
"""Share of its length from the end on the table, at which a thing lies on an edge: more than half, or it tips over"""
STEEPEST = 1.1
"""rad from the horizontal, of what is propped up: steeper, and it slides down with most frictions"""
TOPPLING = 0.8
"""s at most, that a topple takes, for the push and until the thing has fallen"""
_COMING = 4.0
"""s at most, of a hand until it touches what it pushes, wherever it is"""


def maybe_hand(draw: Draw) -> int | None:
    """A hand that is seen to do something, or nobody, in equal shares."""
    return draw.one_of((0, 1, None, None))


def stacks(draft: EpisodeDraft) -> None:
    """Stacks are built, taken apart and moved as a whole, by hands or by nobody who is seen."""
    draw = draft.draw
    towers = [[draft.stand(draw.one_of(SOLIDS)(draw))] for _ in range(draw.count(2, 4))]
    for tower in towers:
        while draw.chance(0.4) and len(draft.objects) < 8:
            tower.append(draft.put_on(draw.one_of(SOLIDS)(draw), tower[-1]))
    draft.bystanders()
    for _ in range(draw.count(1, 3)):
        source, target = draw.some_of([tower for tower in towers if tower], 2)
        _stack(draft, source, target)
        towers = [tower for tower in towers if tower]
        if len(towers) < 2:
            break
    if draw.chance(0.3) and (tall := [tower for tower in towers if len(tower) > 1]):
        top = draw.one_of(tall)[-1]
        hand = draw.one_of((0, None))
        topple = Topple(at=draft.now, object=top, direction=draw.direction(), hand=hand)
        draft.do(topple, TOPPLING + (_COMING if hand is not None else 0.0))


def _stack(draft: EpisodeDraft, source: list[str], target: list[str]) -> None:
    """Move the top of one tower onto another, or a whole tower elsewhere."""
    draw = draft.draw
    if len(source) > 1 and draw.chance(0.25):
        base = source[0]
        spot = draft.free_spot(draft.bodies[base].radius)
        draft.slide(base, spot, hand=None)
        return
    name = source.pop()
    if not source:
        draft.vacate(name)
    x, y = draft.spot(target[0])
    height = sum(draft.bodies[other].size[2] for other in target)
    z = TOP + height + draft.bodies[name].size[2] / 2 + CLEARANCE
    target.append(name)
    draft.carry(name, (x, y, z), hand=maybe_hand(draw))


def perturbations(draft: EpisodeDraft) -> None:
    """Things are swapped, turned, moved, shoved, toppled and taken away."""
    draw = draft.draw
    names = [draft.stand(draw.one_of(SOLIDS)(draw)) for _ in range(draw.count(2, 4))]
    names += draft.bystanders()
    for name in draw.some_of(names, draw.count(1, 3)):
        perturb(draft, name, [other for other in names if other != name])


def perturb(draft: EpisodeDraft, name: str, others: list[str]) -> None:
    """Something sudden happens to a thing that stands on the table."""
    draw = draft.draw
    what = draw.one_of(("swap", "place", "slide", "turn", "push", "topple", "remove"))
    hand = maybe_hand(draw)
    coming = _COMING if hand is not None else 0.0
    if what == "swap" and others:
        other = draw.one_of(others)
        first, second = draft.bodies[name].radius, draft.bodies[other].radius
        if abs(first - second) > GAP:
            raise CrowdedError("what is swapped is of very different sizes")
        draft.do(Swap(at=draft.now, object=name, other=other), 0.0)
        here, there = draft.spot(name), draft.spot(other)
        draft.occupy(name, there)
        draft.occupy(other, here)
    elif what in ("place", "swap"):
        x, y = draft.free_spot(draft.bodies[name].radius)
        draft.occupy(name, (x, y))
        draft.do(PlaceEvent(at=draft.now, object=name, position=(x, y, draft.on_table(name)), yaw=draw.angle()), 0.0)
    elif what == "slide":
        way = draw.number(NumberRange(0.05, 0.2))
        a, b = draw.direction()
        x, y = draft.spot(name)
        draft.slide(name, (round(x + way * a, 4), round(y + way * b, 4)), hand=hand)
    elif what == "turn":
        draft.slide(name, draft.spot(name), hand=hand, turn=draw.number(NumberRange(0.4, 1.6)))
    elif what == "push":
        shove(draft, name, hand)
    elif what == "topple":
        draft.do(Topple(at=draft.now, object=name, direction=draw.direction(), hand=hand), coming + TOPPLING)
    else:
        draft.vacate(name)
        draft.do(Remove(at=draft.now, object=name), 0.0)


def shove(draft: EpisodeDraft, name: str, hand: int | None) -> None:
    """Give a thing a velocity over the table."""
    draw = draft.draw
    (a, b), speed = draw.direction(), draw.number(SHOVE)
    velocity = (round(speed * a, 4), round(speed * b, 4), 0.0)
    draft.do(Push(at=draft.now, object=name, velocity=velocity, hand=hand), _COMING + 0.5 if hand is not None else 0.5)


def leaning(draft: EpisodeDraft) -> None:
    """Boards lean against boxes, and cans lie; what holds them up is moved, and what lies is pushed."""
    draw = draft.draw
    support = draft.stand(draw.one_of((box, wall))(draw) if draw.chance() else wall(draw), yaw=0.0)
    leaner = lean_against(draft, support)
    lying = [lie(draft) for _ in range(draw.count(0, 2))]
    draft.bystanders()
    hand = maybe_hand(draw)
    what = draw.one_of(("support", "leaner", "remove", "tilt", *("lying" for _ in lying)))
    if what == "support":
        x, y = draft.spot(support)
        way = draw.number(NumberRange(0.05, 0.15))
        draft.slide(support, (round(x + way, 4), y), hand=hand)
    elif what == "leaner":
        shove(draft, leaner, None)
    elif what == "remove":
        draft.do(Remove(at=draft.now, object=support), 0.0)
    elif what == "tilt":
        upright = draft.stand(box(draw))
        angle = draw.number(NumberRange(0.6, 1.4))
        axis = (*draw.direction(), 0.0)
        draft.carry(upright, (*draft.spot(upright), draft.on_table(upright) + 0.08), hand=None, height=0.02)
        draft.do(Tilt(at=draft.now, object=upright, angle=angle, axis=axis), angle)
        draft.do(Drop(at=draft.now, object=upright), 0.5)
    for name in lying[: 1 if what == "lying" else draw.count(0, len(lying))]:
        shove(draft, name, None)


def propped(draft: EpisodeDraft) -> None:
    """Planks and boxes lie aslant, one end on a thing and the other on the table; then something is moved or shoved."""
    draw = draft.draw
    pairs = [prop_up(draft) for _ in range(draw.count(1, 2))]
    lying = [lie(draft) for _ in range(draw.count(0, 1))]
    draft.bystanders()
    for support, leaner in draw.some_of(pairs, draw.count(1, len(pairs))):
        what = draw.one_of(("support", "leaner", "remove", "other"))
        if what == "support":
            (x, y), (a, b), way = draft.spot(support), draw.direction(), draw.number(NumberRange(0.03, 0.12))
            draft.slide(support, (round(x + way * a, 4), round(y + way * b, 4)), hand=maybe_hand(draw))
        elif what == "leaner":
            shove(draft, leaner, None)
        elif what == "remove":
            draft.do(Remove(at=draft.now, object=support), 0.0)
    others = [name for name in draft.standing if not any(name in pair for pair in pairs) and name not in lying]
    for name in draw.some_of([*lying, *others], 1):
        shove(draft, name, None)


def prop_up(draft: EpisodeDraft) -> tuple[str, str]:
    """Let a plank lie with one end on the edge of a solid thing, or a solid thing with one side on a plank."""
    draw = draft.draw
    lower, upper = draw.one_of(((cube, plank), (box, plank), (plank, box), (plank, cube)))
    turn = draw.angle()
    support = draft.stand(lower(draw), yaw=turn)
    spec = next(spec for spec in draft.objects if spec.name == support)
    body, share = upper(draw), draw.number(PROPPED_AT)
    (length, _, height), edge = body.size, spec.size[2]
    sine = edge / (share * length)
    if sine > math.sin(STEEPEST):
        raise CrowdedError("the thing is too short for what props it up")
    cosine = math.sqrt(1.0 - sine**2)
    across = -spec.size[0] / 2 - (share - 0.5) * length * cosine - height / 2 * sine
    z = TOP + edge - (share - 0.5) * length * sine + height / 2 * cosine + CLEARANCE
    x, y = spec.position[0] + across * math.cos(turn), spec.position[1] + across * math.sin(turn)
    leaner = draft.add(body, (x, y, z), yaw=turn, lean=(0.0, -round(math.asin(sine), 4), 0.0))
    draft.occupy(leaner, (x, y))
    return support, leaner


def lean_against(draft: EpisodeDraft, support: str) -> str:
    """Let a board lean against the side of a box that is turned along the world's axes, so that it faces +x."""
    draw, spec = draft.draw, next(spec for spec in draft.objects if spec.name == support)
    body, angle = board(draw), draw.number(LEAN)
    thickness, _, height = body.size
    sine, cosine = math.sin(angle), math.cos(angle)
    if height * cosine > spec.size[2]:
        raise CrowdedError("the board is higher than what it leans against")
    reach = (height * sine + thickness * cosine) / 2
    x = spec.position[0] - spec.size[0] / 2 - reach - 0.001  # m, that it falls against the box
    z = TOP + (height * cosine + thickness * sine) / 2 + CLEARANCE
    name = draft.add(body, (x, spec.position[1], z), yaw=0.0, lean=(0.0, angle, 0.0))
    draft.occupy(name, (x, spec.position[1]))
    return name


def lie(draft: EpisodeDraft) -> str:
    """Let a can lie on its side; returns its name."""
    body = can(draft.draw)
    x, y = draft.free_spot(body.radius + body.size[2] / 2)
    name = draft.add(body, (x, y, TOP + body.size[0] / 2 + CLEARANCE), lean=(round(math.pi / 2, 4), 0.0, 0.0))
    draft.occupy(name, (x, y))
    return name
