"""Episodes of things in, under and out of others: containers, covers, pouring."""

from __future__ import annotations

import math

from agents.scenario.format.scenario import Tilt
from agents.scenario.generate.bodies import VESSELS, LooseBody, cover, crate, cup, inner_width, lid, small, tray
from agents.scenario.generate.draft import CLEARANCE, TOP, CrowdedError, EpisodeDraft
from agents.scenario.generate.draw import NumberRange
from agents.scenario.generate.families.piles import maybe_hand

POURED = NumberRange(1.9, 2.6)
"""rad by which a vessel is tilted to pour it out: well beyond lying"""
ABOVE = NumberRange(0.04, 0.08)
"""m, from the rim of what is poured into up to the lip of what is poured"""
_TILT_SPEED = 1.0
"""rad/s, of a vessel that is tilted"""


def containers(draft: EpisodeDraft) -> None:
    """Things are put into vessels, come along with them, are covered by lids and taken out again."""
    draw = draft.draw
    vessels = [draft.stand(draw.one_of(VESSELS)(draw)) for _ in range(draw.count(1, 2))]
    inside = [draft.put_in(_content(draft, vessel), vessel) for vessel in vessels if draw.chance(0.6)]
    loose = [draft.stand(small(draw, 0.06)) for _ in range(draw.count(1, 2))]
    draft.bystanders()
    filled = {spec for spec in vessels if any(_is_over(draft, name, spec) for name in inside)}
    target = draw.one_of(vessels)
    if target not in filled and max(draft.bodies[loose[0]].size) < 0.8 * inner_width(draft.bodies[target]):
        _put_in(draft, loose[0], target, maybe_hand(draw))
    for vessel in draw.some_of(vessels, draw.count(1, 2)):
        if vessel not in filled and draw.chance(0.25):
            _cover_with_lid(draft, vessel)
            continue
        spot = draft.free_spot(draft.bodies[vessel].radius)
        if draw.chance():
            draft.slide(vessel, spot, hand=maybe_hand(draw))
        else:
            draft.carry(vessel, (*spot, draft.on_table(vessel)), hand=draw.count(0, 1), height=0.1)
            draft.occupy(vessel, spot)
    if inside and draw.chance(0.4):
        name = draw.one_of(inside)
        x, y = draft.free_spot(draft.bodies[name].radius)
        draft.carry(name, (x, y, draft.on_table(name)), hand=maybe_hand(draw), height=0.2)


def covers(draft: EpisodeDraft) -> None:
    """Things are hidden under covers, pushed along under them and found again."""
    draw = draft.draw
    one = draft.stand(cover(draw))
    hidden = draft.stand(small(draw, 0.6 * inner_width(draft.bodies[one])))
    other = draft.stand(cover(draw)) if draw.chance(0.4) else None
    draft.bystanders()
    hand = maybe_hand(draw)
    x, y = draft.spot(hidden)
    draft.vacate(hidden)
    draft.vacate(one)
    radius = draft.bodies[one].radius
    if other is not None and math.dist((x, y), draft.spot(other)) < radius + draft.bodies[other].radius:
        raise CrowdedError("no room for the cover")
    draft.carry(one, (x, y, draft.on_table(one)), hand=hand)
    draft.occupy(one, (x, y))
    for _ in range(draw.count(0, 2)):
        moved = draw.one_of([one] if other is None else [one, other])
        draft.slide(moved, draft.free_spot(draft.bodies[moved].radius), hand=hand)
    if draw.chance(0.6):
        spot = draft.free_spot(radius)
        draft.carry(one, (*spot, draft.on_table(one)), hand=hand)


def pouring(draft: EpisodeDraft) -> None:
    """What is in a vessel is poured into or beside another one."""
    draw = draft.draw
    source_body = draw.one_of((cup, crate))(draw)
    target_body = draw.one_of((crate, tray, crate))(draw)
    source, target = draft.stand(source_body, yaw=0.0), draft.stand(target_body, yaw=0.0)
    for _ in range(draw.count(1, 1 if source_body.what == "cup" else 2)):
        content = small(draw, 0.45 * inner_width(source_body))
        _put_beside(draft, content, source)
    draft.bystanders()
    hand = draw.count(0, 1)
    start, goal = draft.spot(source), draft.spot(target)
    away = (start[0] - goal[0], start[1] - goal[1])
    length = math.hypot(*away)
    a, b = away[0] / length, away[1] / length
    angle = draw.number(POURED)
    half = source_body.size[0] / 2, source_body.size[2] / 2
    out, down = math.cos(angle) * half[0] + math.sin(angle) * half[1], math.sin(angle) * half[0]
    down -= math.cos(angle) * half[1]
    aside = draw.number(NumberRange(0.0, 0.05)) + max(out, 0.0)  # m, by which people pour beside the middle
    z = TOP + target_body.size[2] + max(down, 0.0) + draw.number(ABOVE)
    draft.grasp(source, hand, (round(a, 4), round(b, 4)))
    draft.move(hand, (*start, z), z - TOP)
    draft.move(hand, (goal[0] + aside * a, goal[1] + aside * b, z), length)
    axis = (round(b, 4), round(-a, 4), 0.0)  # turned about it by the right hand, the upper side goes to the target
    tilt = Tilt(at=draft.now, object=source, angle=angle, axis=axis, speed=_TILT_SPEED, hand=hand)
    draft.do(tilt, angle / _TILT_SPEED + 0.5)
    back = Tilt(at=draft.now, object=source, angle=-angle, axis=axis, speed=_TILT_SPEED, hand=hand)
    draft.do(back, angle / _TILT_SPEED)
    draft.move(hand, (*start, z), length)
    draft.move(hand, (*start, draft.on_table(source)), z - TOP)
    draft.leave(hand)


def _content(draft: EpisodeDraft, vessel: str) -> LooseBody:
    """Something that fits into a vessel; in a crate, at times another vessel."""
    room = inner_width(draft.bodies[vessel])
    if draft.bodies[vessel].what in ("crate", "tray") and draft.draw.chance(0.3):
        nested = cup(draft.draw)
        if nested.size[0] < 0.8 * room:
            return nested
    return small(draft.draw, room)


def _put_beside(draft: EpisodeDraft, body: LooseBody, vessel: str) -> None:
    """Put a body into a vessel, above what is in it already."""
    name = draft.put_in(body, vessel)
    above = [other for other in draft.objects if other.name != name and _is_over(draft, other.name, vessel)]
    if above:
        raise CrowdedError("the vessel is full")


def _is_over(draft: EpisodeDraft, name: str, vessel: str) -> bool:
    """Whether a thing starts in the middle of a vessel."""
    first, second = (next(spec for spec in draft.objects if spec.name == one) for one in (name, vessel))
    return name != vessel and first.position[:2] == second.position[:2]


def _put_in(draft: EpisodeDraft, name: str, vessel: str, hand: int | None) -> None:
    """Carry a thing to just above the rim of a vessel and let it fall in."""
    x, y = draft.spot(vessel)
    draft.vacate(name)
    rim = TOP + draft.bodies[vessel].size[2]
    draft.carry(name, (x, y, rim + draft.bodies[name].size[2] / 2 + 0.01), hand=hand)  # m above the rim


def _cover_with_lid(draft: EpisodeDraft, vessel: str) -> None:
    body = lid(draft.draw, draft.bodies[vessel])
    name = draft.stand(body)
    x, y = draft.spot(vessel)
    draft.vacate(name)
    z = TOP + draft.bodies[vessel].size[2] + body.size[2] / 2 + CLEARANCE
    draft.carry(name, (x, y, z), hand=maybe_hand(draft.draw))
