"""Episodes of things that go on by themselves: balls roll, things tip over and fall off the table."""

from __future__ import annotations

import math

from agents.scenario.format.scenario import Drop, Lift, Push, Roll
from agents.scenario.generate.bodies import ball, box, can, wall
from agents.scenario.generate.draft import TOP, EpisodeDraft
from agents.scenario.generate.draw import NumberRange
from agents.scenario.generate.families.piles import maybe_hand

ROLL = NumberRange(0.15, 0.7)
"""m/s, of a ball that somebody sets rolling: from one that stops at once to one that rolls off the table"""
DROP = NumberRange(0.05, 0.3)
"""m, from which things are dropped"""
TIP = NumberRange(0.6, 1.5)
"""m/s that a push gives a thing at the edge: enough to go over it"""


def rolling(draft: EpisodeDraft) -> None:
    """Balls roll, also out of sight; things are dropped, tip over, and are pushed off the table."""
    draw = draft.draw
    screens = [draft.stand(wall(draw)) for _ in range(draw.count(0, 2))]
    balls = [draft.stand(ball(draw)) for _ in range(draw.count(1, 3))]
    draft.bystanders()
    edge = _at_the_edge(draft) if draw.chance(0.35) else None
    for name in balls[: draw.count(1, len(balls))]:
        _set_rolling(draft, name, screens)
    if draw.chance(0.3):
        name = draw.one_of(balls)
        height = draw.number(DROP)
        draft.do(Lift(at=draft.now, object=name, height=height, speed=draft.speed), height / draft.speed)
        draft.do(Drop(at=draft.now, object=name), 0.5)
    if edge is not None:
        name, (a, b) = edge
        speed = draw.number(TIP)
        draft.do(Push(at=draft.now, object=name, velocity=(round(speed * a, 4), round(speed * b, 4), 0.0)), 1.0)


def _set_rolling(draft: EpisodeDraft, name: str, screens: list[str]) -> None:
    """Let a ball roll: behind something that hides it, or anywhere."""
    draw, hand = draft.draw, maybe_hand(draft.draw)
    a, b = draw.direction()
    if screens and draw.chance():
        x, y = draft.spot(name)
        hidden = behind(draft, draw.one_of(screens))
        length = math.dist((x, y), hidden) or 1.0
        a, b = (hidden[0] - x) / length, (hidden[1] - y) / length
    speed = draw.number(ROLL)
    velocity = (round(speed * a, 4), round(speed * b, 4))
    draft.do(Roll(at=draft.now, object=name, velocity=velocity, hand=hand), 5.0 if hand is not None else 1.0)


def behind(draft: EpisodeDraft, screen: str, gap: float = 0.02) -> tuple[float, float]:
    """A place (m, world) that a thing on the table hides from the camera, `gap` m behind it."""
    x, y = draft.spot(screen)
    eye = draft.camera.position
    length = math.dist((x, y), eye[:2])
    reach = draft.bodies[screen].radius + gap
    return round(x + reach * (x - eye[0]) / length, 4), round(y + reach * (y - eye[1]) / length, 4)


def _at_the_edge(draft: EpisodeDraft) -> tuple[str, tuple[float, float]]:
    """Let a thing stand near the edge of the table; its name, and the direction over the edge."""
    draw = draft.draw
    body = draw.one_of((box, can))(draw)
    side = draw.one_of((-1.0, 1.0))
    x = side * (draft.table.size[0] / 2 - body.radius - 0.01)  # m, that it stands within the edge
    y = draw.number(NumberRange(-0.2, 0.2))
    name = draft.add(body, (x, y, TOP + body.size[2] / 2))
    draft.occupy(name, (x, y))
    return name, (side, 0.0)
